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

/// Number of bits per coordinate in a Morton code; three coordinates fit into a 64-bit word.
pub(super) const CURVE_BITS: u32 = 21;

/// Returns the order of rows along a Morton curve. `cell` returns coordinates of [`CURVE_BITS`] bits.
pub(super) fn morton_order(n_rows: usize, cell: impl Fn(usize) -> [u64; 3] + Sync) -> Vec<u32> {
    let key = |i: u32| {
        let [x, y, z] = cell(i as usize);
        spread_bits(x) | spread_bits(y) << 1 | spread_bits(z) << 2
    };
    let keys = (0..n_rows as u32).into_par_iter().map(|i| (key(i), i));
    let mut keys: Vec<(u64, u32)> = keys.collect();
    keys.par_sort_unstable();
    keys.into_iter().map(|(_, i)| i).collect()
}

/// Spreads the lower 21 bits of `v`, with two zero bits between neighbours.
fn spread_bits(v: u64) -> u64 {
    let v = (v | v << 32) & 0x001F_0000_0000_FFFF;
    let v = (v | v << 16) & 0x001F_0000_FF00_00FF;
    let v = (v | v << 8) & 0x100F_00F0_0F00_F00F;
    let v = (v | v << 4) & 0x10C3_0C30_C30C_30C3;
    (v | v << 2) & 0x1249_2492_4924_9249
}

/// Quantile of the splats' sizes that represents a small splat.
const SMALL_QUANTILE: f64 = 0.1;
/// Number of splats sampled to estimate the quantile.
const N_SAMPLED: usize = 4096;

/// Returns the size of a small splat; `size` is some measure of it. There must be rows.
#[expect(clippy::indexing_slicing, reason = "an export without rows is refused before")]
pub(super) fn small_quantile(rows: &impl SplatRows, size: impl Fn(&Gaussian) -> f64) -> f64 {
    let step = rows.n_rows().div_ceil(N_SAMPLED).max(1);
    let mut sizes: Vec<f64> =
        (0..rows.n_rows()).step_by(step).map(|i| size(&rows.row(i))).collect();
    sizes.sort_by(f64::total_cmp);
    sizes[(sizes.len() as f64 * SMALL_QUANTILE) as usize]
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bits_are_spread_to_every_third_place() {
        for v in [0, 1, 0x1F_FFFF, 0x15_5555, 0x0A_AAAA, 0x12_3456, 0x1E_DCBA] {
            let expected: u64 = (0..CURVE_BITS).map(|bit| (v >> bit & 1) << (3 * bit)).sum();
            assert_eq!(spread_bits(v), expected, "{v:x}");
        }
    }
}
