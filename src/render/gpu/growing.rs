//! Buffers that grow on demand.

use super::adapters::max_buffer_bytes;
use super::error::GpuError;
use super::readback::poll_once;
use rayon::prelude::*;
use std::fmt;
use std::future::Future;
use std::pin::Pin;
use wgpu::{BufferUsages as Usage, WriteOnly};

const MIB: u64 = 1 << 20;
/// Initial size in bytes; a binding cannot be empty.
const INITIAL_BYTES: u64 = 256;

/// Buffer of a task, as large as the largest size requested so far.
#[derive(Debug)]
pub(super) struct GrowingBuffer {
    buffer: wgpu::Buffer,
    label: &'static str,
    usage: Usage,
}

impl GrowingBuffer {
    /// Creates a small buffer. With `MAP_WRITE` it starts mapped and must be mapped again after each upload.
    pub(super) fn new(device: &wgpu::Device, label: &'static str, usage: Usage) -> Self {
        Self { buffer: create_buffer(device, label, usage, INITIAL_BYTES), label, usage }
    }

    pub(super) fn buffer(&self) -> &wgpu::Buffer {
        &self.buffer
    }

    /// Ensures a size of at least `needed` bytes. Returns true if the buffer was replaced, which loses its
    /// contents.
    ///
    /// # Errors
    /// [`GpuError::TaskTooLarge`], [`GpuError::NoMemoryForTask`]; the buffer is unchanged then.
    pub(super) fn ensure_capacity(
        &mut self,
        device: &wgpu::Device,
        needed: u64,
    ) -> Result<bool, GpuError> {
        let limits = device.limits();
        let is_bound = self.usage.contains(Usage::STORAGE);
        let most = if is_bound { max_buffer_bytes(&limits) } else { limits.max_buffer_size };
        if needed > most {
            let [needed_mib, limit_mib] = [needed, most].map(|bytes| bytes.div_ceil(MIB));
            return Err(GpuError::TaskTooLarge { what: self.label, needed_mib, limit_mib });
        }
        let is_small = needed > self.buffer.size();
        if is_small {
            // Larger than needed, because scenes grow frame by frame.
            let bytes = (needed + needed / 2).min(most) / 4 * 4;
            let refused = GpuError::NoMemoryForTask { what: self.label, mib: bytes.div_ceil(MIB) };
            // An error that arrives later still goes to the fault handler.
            let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
            let buffer = create_buffer(device, self.label, self.usage, bytes);
            if poll_once(scope.pop()).flatten().is_some() {
                return Err(refused);
            }
            self.buffer = buffer;
        }
        Ok(is_small)
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

const PIECE_BYTES: usize = 1 << 14;

/// Minimum number of pieces per task: waking a thread takes about as long as copying a few.
const TASK: usize = 8;

/// Copies the pieces consecutively into the first `bytes` bytes of a mapped buffer, on all threads.
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
    // Fixed-size pieces, because only those can be sent to other threads.
    let mut tasks: Vec<(WriteOnly<'_, [u8; PIECE_BYTES]>, &[u8; PIECE_BYTES])> = Vec::new();
    for piece in pieces {
        let to = rest.split_off(..piece.len()).unwrap_or_default();
        let (to, mut end) = to.into_chunks::<PIECE_BYTES>();
        let (from, left) = piece.as_chunks::<PIECE_BYTES>();
        tasks.extend(to.into_iter().zip(from));
        end.copy_from_slice(left);
    }
    let tasks = tasks.into_par_iter().with_min_len(TASK);
    tasks.for_each(|(to, from)| WriteOnly::<[u8]>::from(to).copy_from_slice(from));
    Ok(())
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
