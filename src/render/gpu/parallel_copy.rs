//! Copies into mapped memory on all threads: one alone fills memory that a device reads too slowly.

use rayon::prelude::*;
use wgpu::WriteOnly;

/// Bytes that a task copies at a time.
const COPIED: usize = 1 << 14;

/// Copies `from` to memory of its length.
pub(super) fn copy(to: WriteOnly<'_, [u8]>, from: &[u8]) {
    let (pieces, mut rest) = to.into_chunks::<COPIED>();
    let (from, left) = from.as_chunks::<COPIED>();
    // Pieces of a fixed size, since only these may be sent to other threads.
    let pieces: Vec<WriteOnly<'_, [u8; COPIED]>> = pieces.into_iter().collect();
    pieces.into_par_iter().zip(from).for_each(|(to, from)| to.write(*from));
    rest.copy_from_slice(left);
}
