//! Parallel encoding of rows, written in order with one block in memory.
//!
//! Rows are computed on demand, once per column of the format, so memory does not depend on the model size.
//! Encoding dominates the cost (logarithms, quaternions), and rows are independent.

use super::error::Cancelled;
use super::gaussian::Gaussian;
use rayon::prelude::*;
use std::io::Write;
use std::{fmt, io};

/// Number of rows per block. Progress is reported after each written block.
// At most 16 MB of the widest format.
const BLOCK_ROWS: usize = 1 << 16;
/// Number of rows that one thread encodes at a time.
// 16 parts per block share the work among threads.
const PART_ROWS: usize = 1 << 12;

/// Splats in the axes and units of a file, computed on demand.
pub(super) trait SplatRows: Sync {
    fn n_rows(&self) -> usize;

    fn row(&self, row: usize) -> Gaussian;

    /// True if any colour depends on the view direction.
    fn has_directions(&self) -> bool;
}

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
        // Collected in order, so that the file does not depend on the threads.
        for bytes in parts.collect::<Vec<_>>() {
            out.write_all(&bytes)?;
        }
        steps.advance(end - start)?;
    }
    Ok(())
}

pub(super) fn put_floats(row: &mut Vec<u8>, values: &[f64]) {
    for value in values {
        row.extend_from_slice(&(*value as f32).to_le_bytes());
    }
}

/// Progress callback, called between blocks of rows. Receives the completed fraction, 0 to 1, and
/// returns false to cancel writing.
#[derive(Clone, Copy, Default)]
pub struct WriteProgress<'a>(Option<&'a dyn Fn(f64) -> bool>);

impl<'a> WriteProgress<'a> {
    /// No callback.
    pub const NONE: WriteProgress<'static> = WriteProgress(None);

    /// Reports progress to the callback; if it returns `false`, writing ends with
    /// [`super::Fault::Cancelled`].
    pub fn new(callback: &'a dyn Fn(f64) -> bool) -> Self {
        Self(Some(callback))
    }
}

impl fmt::Debug for WriteProgress<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(if self.0.is_some() { "WriteProgress(some)" } else { "WriteProgress(none)" })
    }
}

pub(super) struct ProgressCounter<'a> {
    progress: WriteProgress<'a>,
    done: usize,
    total: usize,
}

impl<'a> ProgressCounter<'a> {
    /// Starts to count up to `total` rows. In a format with separate columns, a row counts once for each
    /// column.
    pub fn new(progress: WriteProgress<'a>, total: usize) -> Self {
        Self { progress, done: 0, total }
    }

    pub fn advance(&mut self, n: usize) -> io::Result<()> {
        self.done += n;
        // A count of zero rows must not divide by zero.
        let share = self.done as f64 / self.total.max(1) as f64;
        match self.progress.0 {
            Some(callback) if !callback(share.min(1.0)) => Err(io::Error::other(Cancelled)),
            _ => Ok(()),
        }
    }
}
