//! Copies into mapped memory on all threads: one alone fills memory that a device reads too slowly.

use rayon::prelude::*;
use wgpu::WriteOnly;

/// Bytes that a task copies at a time.
const COPIED: usize = 1 << 14;

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
    for piece in pieces {
        copy(rest.split_off(..piece.len()).unwrap_or_default(), piece);
    }
    Ok(())
}

/// Copies `from` to memory of its length.
pub(super) fn copy(to: WriteOnly<'_, [u8]>, from: &[u8]) {
    let (pieces, mut rest) = to.into_chunks::<COPIED>();
    let (from, left) = from.as_chunks::<COPIED>();
    // Pieces of a fixed size, since only these may be sent to other threads.
    let pieces: Vec<WriteOnly<'_, [u8; COPIED]>> = pieces.into_iter().collect();
    pieces.into_par_iter().zip(from).for_each(|(to, from)| to.write(*from));
    rest.copy_from_slice(left);
}
