//! Buffers that grow on demand.

use super::context::max_buffer_bytes;
use super::error::GpuError;
use super::poll::poll_once;
use wgpu::BufferUsages as Usage;

const MIB: u64 = 1 << 20;
/// Initial size in bytes; a binding cannot be empty.
const INITIAL_BYTES: u64 = 256;

/// Shader input, filled by copies.
pub(super) const IN: Usage = Usage::STORAGE.union(Usage::COPY_DST);
/// Shader output, source of copies.
pub(super) const OUT: Usage = Usage::STORAGE.union(Usage::COPY_SRC);
/// Staging buffer for uploads.
pub(super) const UPLOAD_STAGING: Usage = Usage::MAP_WRITE.union(Usage::COPY_SRC);
/// Staging buffer for readbacks.
pub(super) const READBACK_STAGING: Usage = Usage::MAP_READ.union(Usage::COPY_DST);

/// Numbered buffers, each as large as the largest size requested so far.
#[derive(Debug)]
pub(super) struct GrowingBuffers(Vec<GrowingBuffer>);

impl GrowingBuffers {
    /// Creates buffers with these labels and usages. Buffers with `MAP_WRITE` start mapped and must be mapped
    /// again after each upload.
    pub(super) fn new(
        device: &wgpu::Device,
        buffers: impl IntoIterator<Item = (&'static str, Usage)>,
    ) -> Self {
        let new = |(label, usage)| GrowingBuffer {
            buffer: create_buffer(device, label, usage, INITIAL_BYTES),
            label,
            usage,
        };
        Self(buffers.into_iter().map(new).collect())
    }

    pub(super) fn get(&self, number: usize) -> &wgpu::Buffer {
        &self.0[number].buffer
    }

    /// Ensures a size of at least `needed` bytes. Returns true if the buffer was replaced, which loses its
    /// contents.
    ///
    /// # Errors
    /// [`GrowthError`]; the buffer is unchanged then.
    pub(super) fn ensure_capacity(
        &mut self,
        device: &wgpu::Device,
        number: usize,
        needed: u64,
    ) -> Result<bool, GrowthError> {
        self.0[number].ensure_capacity(device, needed)
    }

    /// Resizes several buffers, given by number and bytes, for a pass over a frame. Returns true if any was
    /// replaced and lost its contents.
    ///
    /// # Errors
    /// [`GpuError::PassTooLarge`], [`GpuError::NoMemoryForPass`].
    pub(super) fn ensure_pass_capacity(
        &mut self,
        device: &wgpu::Device,
        needed: impl IntoIterator<Item = (usize, u64)>,
    ) -> Result<bool, GpuError> {
        let mut is_lost = false;
        for (number, bytes) in needed {
            let what = self.0[number].label;
            is_lost |=
                self.ensure_capacity(device, number, bytes).map_err(|error| match error {
                    GrowthError::TooLarge { needed_mib, limit_mib } => {
                        GpuError::PassTooLarge { what, needed_mib, limit_mib }
                    }
                    GrowthError::Refused { mib } => GpuError::NoMemoryForPass { what, mib },
                })?;
        }
        Ok(is_lost)
    }
}

#[derive(Debug)]
struct GrowingBuffer {
    buffer: wgpu::Buffer,
    label: &'static str,
    usage: Usage,
}

/// Reason why a buffer could not grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GrowthError {
    /// Exceeds the adapter's limit.
    TooLarge { needed_mib: u64, limit_mib: u64 },
    /// The driver is out of memory.
    Refused { mib: u64 },
}

impl GrowingBuffer {
    fn ensure_capacity(&mut self, device: &wgpu::Device, needed: u64) -> Result<bool, GrowthError> {
        let limits = device.limits();
        let is_bound = self.usage.contains(Usage::STORAGE);
        let most = if is_bound { max_buffer_bytes(&limits) } else { limits.max_buffer_size };
        if needed > most {
            let [needed_mib, limit_mib] = [needed, most].map(|bytes| bytes.div_ceil(MIB));
            return Err(GrowthError::TooLarge { needed_mib, limit_mib });
        }
        let is_small = needed > self.buffer.size();
        if is_small {
            // Larger than needed, because scenes grow frame by frame.
            let bytes = (needed + needed / 2).min(most) / 4 * 4;
            self.buffer = self.create_checked(device, bytes)?;
        }
        Ok(is_small)
    }

    /// Creates a buffer. A separate error scope delivers an out-of-memory error here rather than to the fault
    /// handler; an error that arrives later still goes to that handler.
    fn create_checked(
        &self,
        device: &wgpu::Device,
        bytes: u64,
    ) -> Result<wgpu::Buffer, GrowthError> {
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = create_buffer(device, self.label, self.usage, bytes);
        match poll_once(scope.pop()).flatten() {
            None => Ok(buffer),
            Some(_) => Err(GrowthError::Refused { mib: bytes.div_ceil(MIB) }),
        }
    }
}

fn create_buffer(device: &wgpu::Device, label: &str, usage: Usage, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: usage.contains(Usage::MAP_WRITE),
    })
}
