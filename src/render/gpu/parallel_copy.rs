//! Copies into mapped memory on all threads: one alone fills memory that a device reads too slowly.

use rayon::prelude::*;
use wgpu::WriteOnly;

/// Bytes that a task copies at a time.
const COPIED: usize = 1 << 14;

/// Pieces that a task copies at least: to wake a thread takes as long as some of them.
const TASK: usize = 8;

/// Copies the pieces, one behind the other, to so many bytes of a mapped buffer.
///
/// # Errors
/// What wgpu says of a buffer that is not mapped.
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

/// Copies every `from` to memory of its length, on all threads at once.
pub(super) fn copy_all<'a, 'b>(copies: impl Iterator<Item = (WriteOnly<'a, [u8]>, &'b [u8])>) {
    // Of a fixed size, since only such pieces may be sent to other threads.
    let mut pieces: Vec<(WriteOnly<'_, [u8; COPIED]>, &[u8; COPIED])> = Vec::new();
    for (to, from) in copies {
        let (to, mut end) = to.into_chunks::<COPIED>();
        let (from, left) = from.as_chunks::<COPIED>();
        pieces.extend(to.into_iter().zip(from));
        end.copy_from_slice(left);
    }
    let pieces = pieces.into_par_iter().with_min_len(TASK);
    pieces.for_each(|(to, from)| WriteOnly::<[u8]>::from(to).copy_from_slice(from));
}
