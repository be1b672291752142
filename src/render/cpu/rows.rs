//! Visible records by row of tiles, the rows shared out among the threads.
//!
//! Listed first and sorted by depth then, row by row: what is listed is read in the order in which it
//! lies in memory, lists of a row fit the caches, and all threads sort. Sorted first, the two steps
//! took twice as long for 10⁶ splats on two cores.

use super::buckets::Buckets;
use super::record::DepthEntry;
use super::sort::DepthSorter;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Lists of records by row, the nearest first once they are sorted.
#[derive(Default)]
pub(super) struct RowLists {
    /// Of `rows_each` rows each; the last may have fewer.
    parts: Vec<Buckets>,
    rows_each: usize,
    /// One a thread.
    sorters: Vec<Mutex<DepthSorter>>,
}

impl RowLists {
    /// Lists records, which are given in ascending order. Every thread goes through all of them and keeps
    /// those of its rows, which costs less than putting partial lists together.
    pub(super) fn fill<I: Iterator<Item = u32> + Clone>(
        &mut self,
        n_rows: usize,
        records: impl Fn() -> I + Sync,
        listings: &[DepthEntry],
    ) {
        // At least 1, since it divides below.
        self.rows_each = n_rows.div_ceil(rayon::current_num_threads()).max(1);
        self.parts.resize_with(n_rows.div_ceil(self.rows_each), Buckets::default);
        let rows_each = self.rows_each;
        self.parts.par_iter_mut().enumerate().for_each(|(part, lists)| {
            // The last part may be short.
            let own = part * rows_each..((part + 1) * rows_each).min(n_rows);
            lists.fill(own.len(), records(), |i| within(&own, listings[i as usize].tile_rows()));
        });
    }

    /// Sorts every list by depth.
    pub(super) fn sort(&mut self, listings: &[DepthEntry]) {
        let Self { parts, sorters, .. } = self;
        let n_threads = rayon::current_num_threads().max(sorters.len());
        sorters.resize_with(n_threads, Mutex::default);
        let rows: Vec<&mut [u32]> = parts.iter_mut().flat_map(Buckets::lists_mut).collect();
        // One row a task: rows differ much in how many splats they hold.
        rows.into_par_iter().with_max_len(1).for_each(|row| {
            // Every thread takes its own, so the lock never waits: it is how safe code says so.
            let thread = rayon::current_thread_index().unwrap_or(0) % sorters.len();
            let mut sorter = sorters[thread].lock().unwrap_or_else(PoisonError::into_inner);
            sorter.sort(row, |i| listings[i as usize].key);
        });
    }

    /// Records of one row.
    pub(super) fn get(&self, row: usize) -> &[u32] {
        self.parts[row / self.rows_each].get(row % self.rows_each)
    }
}

/// The part of `rows` that lies in `own`, counted from its start.
fn within(own: &Range<usize>, rows: Range<usize>) -> Range<usize> {
    rows.start.clamp(own.start, own.end) - own.start..rows.end.clamp(own.start, own.end) - own.start
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::render::cpu::record::Rect;

    #[test]
    fn rows_list_the_same_whoever_lists_them() {
        let rects =
            [(0, 40), (33, 48), (5, 6), (0, 80)].map(|(y0, y1)| Rect { x0: 0, x1: 1, y0, y1 });
        let depths = [3.0, 2.0, 9.0, 1.0];
        let listings: [DepthEntry; 4] =
            std::array::from_fn(|i| DepthEntry::new(depths[i], &rects[i]));
        for n_threads in [1, 2, 3, 8] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
            let mut rows = RowLists::default();
            pool.install(|| {
                rows.fill(5, || 0..4, &listings);
                rows.sort(&listings);
            });
            let lists: Vec<&[u32]> = (0..5).map(|row| rows.get(row)).collect();
            assert_eq!(lists, [&[3, 0, 2][..], &[3, 0], &[3, 1, 0], &[3], &[3]], "{n_threads}");
        }
    }
}
