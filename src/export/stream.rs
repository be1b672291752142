//! Rows on their way into a file: encoded on all threads, written in order, a block in memory.
//!
//! Rows are computed from the splats when they are needed, as often as a format has columns: whatever
//! the size of the model, only a block of bytes is kept. Encoding is most of the work, logarithms and
//! quaternions, and each row is by itself.

use super::gaussian::Gaussian;
use super::progress::Steps;
use rayon::prelude::*;
use std::io::{self, Write};

/// Rows encoded before they are written and before progress is told: at most 16 MB of the widest.
const BLOCK_ROWS: usize = 1 << 16;
/// Rows that one thread takes at a time.
const PART_ROWS: usize = 1 << 12;

/// Splats in the axes and units of a file, computed when asked for.
pub(super) trait SplatRows: Sync {
    /// Number of rows.
    fn n_rows(&self) -> usize;

    /// The splat of a row below [`SplatRows::n_rows`].
    fn row(&self, row: usize) -> Gaussian;

    /// Whether some colour depends on the direction it is seen from.
    fn has_directions(&self) -> bool;
}

/// Writes what `encode` adds for each of the rows, in order.
pub(super) fn write_rows(
    out: &mut dyn Write,
    n_rows: usize,
    steps: &mut Steps,
    encode: impl Fn(usize, &mut Vec<u8>) + Sync,
) -> io::Result<()> {
    for start in (0..n_rows).step_by(BLOCK_ROWS) {
        let end = n_rows.min(start + BLOCK_ROWS);
        let parts = (start..end).step_by(PART_ROWS).collect::<Vec<usize>>();
        let parts = parts.into_par_iter().map(|from| {
            let mut bytes = Vec::new();
            (from..end.min(from + PART_ROWS)).for_each(|row| encode(row, &mut bytes));
            bytes
        });
        for bytes in parts.collect::<Vec<_>>() {
            out.write_all(&bytes)?;
        }
        steps.advance(end - start)?;
    }
    Ok(())
}

/// Adds values as little-endian f32.
pub(super) fn put_floats(row: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        row.extend_from_slice(&(*value as f32).to_le_bytes());
    }
}
