//! Multi-threaded copies into mapped memory, because one thread alone is too slow.

use rayon::prelude::*;
use wgpu::WriteOnly;

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
