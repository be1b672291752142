//! Buffers that grow on demand.

use super::adapters::max_buffer_bytes;
use super::error::GpuError;
use super::readback::poll_once;
use rayon::prelude::*;
use std::fmt;
use std::future::Future;
use std::marker::PhantomData;
use std::pin::Pin;
use wgpu::{BufferUsages as Usage, WriteOnly};

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
struct GrowingBuffers(Vec<GrowingBuffer>);

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

/// Contents of one of a kernel's buffers.
pub(super) trait BufferPart: Copy + 'static {
    /// Numbers of items that a call processes.
    type Sizes;
    /// All parts with label and usage, each at its own index.
    const ALL: &'static [(Self, &'static str, Usage)];

    fn index(self) -> usize;

    /// Bytes needed for a call.
    fn bytes(self, sizes: &Self::Sizes) -> u64;
}

/// Buffers of a kernel by their contents.
#[derive(Debug)]
pub(super) struct PartBuffers<P> {
    buffers: GrowingBuffers,
    parts: PhantomData<P>,
}

impl<P: BufferPart> PartBuffers<P> {
    pub(super) fn new(device: &wgpu::Device) -> Self {
        let buffers = P::ALL.iter().map(|(_, label, usage)| (*label, *usage));
        Self { buffers: GrowingBuffers::new(device, buffers), parts: PhantomData }
    }

    pub(super) fn buffer(&self, part: P) -> &wgpu::Buffer {
        self.buffers.get(part.index())
    }

    /// Ensures the size of some parts. Returns true if any was replaced and lost its contents.
    ///
    /// # Errors
    /// [`GpuError::PassTooLarge`], [`GpuError::NoMemoryForPass`].
    pub(super) fn ensure_capacity(
        &mut self,
        device: &wgpu::Device,
        sizes: &P::Sizes,
        parts: &[P],
    ) -> Result<bool, GpuError> {
        let needed = parts.iter().map(|part| (part.index(), part.bytes(sizes)));
        self.buffers.ensure_pass_capacity(device, needed)
    }

    /// Ensures the size of one part.
    ///
    /// # Errors
    /// [`GrowthError`]; the buffer is unchanged then.
    pub(super) fn ensure_part(
        &mut self,
        device: &wgpu::Device,
        sizes: &P::Sizes,
        part: P,
    ) -> Result<bool, GrowthError> {
        self.buffers.ensure_capacity(device, part.index(), part.bytes(sizes))
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

type Answer = Pin<Box<dyn Future<Output = Option<wgpu::Error>> + Send>>;

/// Outcome of an allocation.
pub(super) struct Allocation {
    /// `None` once the driver has responded.
    pending_error: Option<Answer>,
    out_of_memory_error: GpuError,
}

impl Allocation {
    /// Runs `allocate`. If the driver reports that it is out of memory, `refused` is returned, either here or
    /// by a later [`Self::check`].
    pub(super) fn new<T>(
        device: &wgpu::Device,
        refused: GpuError,
        allocate: impl FnOnce() -> T,
    ) -> Result<(T, Self), GpuError> {
        // A separate error scope delivers the error here rather than to the fault handler.
        let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
        let made = allocate();
        let mut allocation =
            Self { pending_error: Some(Box::pin(scope.pop())), out_of_memory_error: refused };
        // Native backends respond immediately; then nothing is built on an invalid buffer.
        allocation.check()?;
        Ok((made, allocation))
    }

    /// Returns the error once if the driver has reported one since the last check.
    pub(super) fn check(&mut self) -> Result<(), GpuError> {
        let Some(said) = self.pending_error.as_mut().and_then(poll_once) else { return Ok(()) };
        // Reported once; later frames continue with the existing buffers.
        self.pending_error = None;
        said.map_or(Ok(()), |_| Err(self.out_of_memory_error.clone()))
    }
}

impl fmt::Debug for Allocation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Allocation").field("is_pending", &self.pending_error.is_some()).finish()
    }
}

/// Bytes per piece.
const PIECE_BYTES: usize = 1 << 14;

/// Minimum number of pieces per task: waking a thread takes about as long as copying a few.
const TASK: usize = 8;

/// Copies the pieces consecutively into the first `bytes` bytes of a mapped buffer.
///
/// # Errors
/// Message from wgpu if the buffer is not mapped.
pub(super) fn copy_pieces<'a>(
    buffer: &wgpu::Buffer,
    bytes: u64,
    pieces: impl IntoIterator<Item = &'a [u8]>,
) -> Result<(), String> {
    let mut mapped = buffer.get_mapped_range_mut(..bytes).map_err(|error| error.to_string())?;
    let mut rest = mapped.slice(..);
    copy_all(pieces.into_iter().map(|piece| {
        let to = rest.split_off(..piece.len()).unwrap_or_default();
        (to, piece)
    }));
    Ok(())
}

/// Copies every `from` to its `to` of equal length, on all threads.
pub(super) fn copy_all<'a, 'b>(copies: impl Iterator<Item = (WriteOnly<'a, [u8]>, &'b [u8])>) {
    // Fixed-size pieces, because only those can be sent to other threads.
    let mut pieces: Vec<(WriteOnly<'_, [u8; PIECE_BYTES]>, &[u8; PIECE_BYTES])> = Vec::new();
    for (to, from) in copies {
        let (to, mut end) = to.into_chunks::<PIECE_BYTES>();
        let (from, left) = from.as_chunks::<PIECE_BYTES>();
        pieces.extend(to.into_iter().zip(from));
        end.copy_from_slice(left);
    }
    let pieces = pieces.into_par_iter().with_min_len(TASK);
    pieces.for_each(|(to, from)| WriteOnly::<[u8]>::from(to).copy_from_slice(from));
}

#[cfg(test)]
mod allocation_tests {
    use super::*;
    use std::sync::{Arc, Mutex};
    use std::task::Poll;

    #[test]
    fn an_answer_that_comes_late_is_an_error_once() {
        let answer: Arc<Mutex<Option<Option<wgpu::Error>>>> = Arc::default();
        let told = answer.clone();
        let refused = GpuError::OutOfMemory { n_splats: 7, mib: 3 };
        let mut allocation = Allocation {
            pending_error: Some(Box::pin(std::future::poll_fn(move |_| {
                told.lock().unwrap().take().map_or(Poll::Pending, Poll::Ready)
            }))),
            out_of_memory_error: refused.clone(),
        };
        assert_eq!(allocation.check(), Ok(()));
        *answer.lock().unwrap() =
            Some(Some(wgpu::Error::OutOfMemory { source: "none left".into() }));
        assert_eq!(allocation.check(), Err(refused));
        assert_eq!(allocation.check(), Ok(()));
    }
}
