//! Parallel encoding of rows, written in order with one block in memory.
//!
//! Rows are computed on demand, once per column of the format, so memory does not depend on the model size.
//! Encoding dominates the cost (logarithms, quaternions), and rows are independent.

use super::gaussian::Gaussian;
use super::progress::ProgressCounter;
use rayon::prelude::*;
use std::io::{self, Write};

/// Rows encoded before they are written and progress is reported: at most 16 MB of the widest format.
const BLOCK_ROWS: usize = 1 << 16;
const PART_ROWS: usize = 1 << 12;

/// Splats in the axes and units of a file, computed on demand.
pub(super) trait SplatRows: Sync {
    fn n_rows(&self) -> usize;

    /// Returns the splat of a row below [`SplatRows::n_rows`].
    fn row(&self, row: usize) -> Gaussian;

    /// True if any colour depends on the view direction.
    fn has_directions(&self) -> bool;
}

/// Writes the bytes that `encode` appends for each row, in order.
pub(super) fn write_rows(
    out: &mut dyn Write,
    n_rows: usize,
    steps: &mut ProgressCounter,
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

/// Appends values as little-endian f32.
pub(super) fn put_floats(row: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        row.extend_from_slice(&(*value as f32).to_le_bytes());
    }
}
