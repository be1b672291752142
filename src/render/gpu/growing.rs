//! Buffers that grow with what they are asked to hold.

use super::context::max_buffer_bytes;
use super::error::GpuError;
use super::poll::ready;
use wgpu::BufferUsages as Usage;

const MIB: u64 = 1 << 20;
/// Bytes before anything is asked for: a binding cannot be empty.
const SMALLEST: u64 = 256;

/// What shaders read, from a buffer on its way in.
pub(super) const IN: Usage = Usage::STORAGE.union(Usage::COPY_DST);
/// What shaders write, for a buffer on its way out.
pub(super) const OUT: Usage = Usage::STORAGE.union(Usage::COPY_SRC);
/// What goes to the GPU, on its way.
pub(super) const WAY_IN: Usage = Usage::MAP_WRITE.union(Usage::COPY_SRC);
/// What comes back, on its way.
pub(super) const WAY_OUT: Usage = Usage::MAP_READ.union(Usage::COPY_DST);

/// Buffers by number, each as large as anything asked of it so far.
#[derive(Debug)]
pub(super) struct GrowingBuffers(Vec<GrowingBuffer>);

impl GrowingBuffers {
    /// Of these names and uses. One that may be written by mapping is mapped whenever nothing on its way
    /// is in it.
    pub(super) fn new(
        device: &wgpu::Device,
        buffers: impl IntoIterator<Item = (&'static str, Usage)>,
    ) -> Self {
        let new = |(label, usage)| GrowingBuffer {
            buffer: made(device, label, usage, SMALLEST),
            label,
            usage,
        };
        Self(buffers.into_iter().map(new).collect())
    }

    pub(super) fn get(&self, number: usize) -> &wgpu::Buffer {
        &self.0[number].buffer
    }

    /// Makes room for so many bytes in one; whether what was there is lost, as it is if there was less.
    ///
    /// # Errors
    /// [`GrowthError`]; the buffer is as it was then.
    pub(super) fn make_room(
        &mut self,
        device: &wgpu::Device,
        number: usize,
        needed: u64,
    ) -> Result<bool, GrowthError> {
        self.0[number].make_room(device, needed)
    }

    /// Makes room in some, by number and bytes, for a pass over a frame; whether any has lost what was there.
    ///
    /// # Errors
    /// [`GpuError::PassTooLarge`], [`GpuError::NoMemoryForPass`].
    pub(super) fn make_room_for_pass(
        &mut self,
        device: &wgpu::Device,
        needed: impl IntoIterator<Item = (usize, u64)>,
    ) -> Result<bool, GpuError> {
        let mut is_lost = false;
        for (number, bytes) in needed {
            let what = self.0[number].label;
            is_lost |= self.make_room(device, number, bytes).map_err(|error| match error {
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

/// Why a buffer did not grow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum GrowthError {
    /// The adapter binds no such buffer.
    TooLarge { needed_mib: u64, limit_mib: u64 },
    /// The driver has no memory.
    Refused { mib: u64 },
}

impl GrowingBuffer {
    fn make_room(&mut self, device: &wgpu::Device, needed: u64) -> Result<bool, GrowthError> {
        let limits = device.limits();
        let is_bound = self.usage.contains(Usage::STORAGE);
        let most = if is_bound { max_buffer_bytes(&limits) } else { limits.max_buffer_size };
        if needed > most {
            let [needed_mib, limit_mib] = [needed, most].map(|bytes| bytes.div_ceil(MIB));
            return Err(GrowthError::TooLarge { needed_mib, limit_mib });
        }
        let is_small = needed > self.buffer.size();
        if is_small {
            // Some more than needed: scenes grow frame by frame.
            let bytes = (needed + needed / 2).min(most) / 4 * 4;
            self.buffer = self.refusable(device, bytes)?;
        }
        Ok(is_small)
    }

    /// Takes the driver's refusal from a scope of its own, so that it comes here and not to whoever hears
    /// of faults. A backend that answers later is heard of by these.
    fn refusable(&self, device: &wgpu::Device, bytes: u64) -> Result<wgpu::Buffer, GrowthError> {
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let buffer = made(device, self.label, self.usage, bytes);
        match ready(scope.pop()).flatten() {
            None => Ok(buffer),
            Some(_) => Err(GrowthError::Refused { mib: bytes.div_ceil(MIB) }),
        }
    }
}

fn made(device: &wgpu::Device, label: &str, usage: Usage, size: u64) -> wgpu::Buffer {
    device.create_buffer(&wgpu::BufferDescriptor {
        label: Some(label),
        size,
        usage,
        mapped_at_creation: usage.contains(Usage::MAP_WRITE),
    })
}
