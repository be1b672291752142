//! Buffers that grow on demand, and buffers filled once.

use super::adapters::{max_buffer_bytes, poll_once};
use super::error::GpuError;
use super::task::WORD;
use rayon::prelude::*;
use wgpu::{BufferUsages as Usage, WriteOnly};

pub(super) const MIB: u64 = 1 << 20;
// Initial size in bytes; a binding cannot be empty.
const INITIAL_BYTES: u64 = 256;

/// GPU buffer that is at least as large as the largest size requested so far.
#[derive(Debug)]
pub(super) struct GrowingBuffer {
    pub(super) buffer: wgpu::Buffer,
    label: &'static str,
    usage: Usage,
}

impl GrowingBuffer {
    /// Creates a small buffer. With `MAP_WRITE` it starts mapped and must be mapped again after each
    /// upload.
    pub(super) fn new(device: &wgpu::Device, label: &'static str, usage: Usage) -> Self {
        Self { buffer: create_buffer(device, label, usage, INITIAL_BYTES), label, usage }
    }

    /// Ensures a size of at least `needed` bytes. Returns true if the buffer was replaced, which loses
    /// its contents.
    ///
    /// # Errors
    /// [`GpuError::TaskTooLarge`] or [`GpuError::NoMemoryForTask`]. In either case the buffer is
    /// unchanged.
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
            // Larger than needed, because scenes grow frame by frame. Rounded down to whole words, which
            // copies and bindings require.
            let bytes = (needed + needed / 2).min(most) / 4 * 4;
            let refused = GpuError::NoMemoryForTask { what: self.label, mib: bytes.div_ceil(MIB) };
            let create = || create_buffer(device, self.label, self.usage, bytes);
            self.buffer = allocate(device, refused, create)?;
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

/// Creates a buffer with the given contents, whose length must be a multiple of four bytes.
pub(super) fn filled_buffer(
    device: &wgpu::Device,
    queue: &wgpu::Queue,
    label: &str,
    usage: Usage,
    contents: &[u8],
) -> wgpu::Buffer {
    // A binding cannot be empty.
    let size = (contents.len() as u64).max(WORD);
    // Not mapped at creation: a lost device has no memory to map, and wgpu panics.
    let buffer = create_buffer(device, label, usage.union(Usage::COPY_DST), size);
    queue.write_buffer(&buffer, 0, contents);
    buffer
}

/// Creates buffers by calling `create`. Returns the error `refused` if the driver reports that it is
/// out of memory.
pub(super) fn allocate<T>(
    device: &wgpu::Device,
    refused: GpuError,
    create: impl FnOnce() -> T,
) -> Result<T, GpuError> {
    // A separate error scope delivers the error here rather than to the fault handler.
    let scope = device.push_error_scope(wgpu::ErrorFilter::OutOfMemory);
    let made = create();
    // Native backends respond immediately; then nothing is built on an invalid buffer.
    if poll_once(scope.pop()).flatten().is_some() { Err(refused) } else { Ok(made) }
}

const PIECE_BYTES: usize = 1 << 14;

// Minimum number of pieces per task: waking a thread takes about as long as copying a few.
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
