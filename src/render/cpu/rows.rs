//! Lists of visible records per row of tiles.
//!
//! Records are listed first and then sorted by depth, row by row. Listing thus reads memory sequentially,
//! the lists of a row fit the caches, and all threads sort. In the opposite order both steps took twice as
//! long for 10⁶ splats on two cores.

use super::buckets::Buckets;
use super::longest_first::longest_first;
use super::record::DepthEntry;
use super::sort::DepthSorter;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Groups of runs per thread, for load balancing: runs differ in their number of records.
const GROUPS: usize = 4;

/// Lists of records per row, nearest first after sorting.
#[derive(Default)]
pub(super) struct RowLists {
    rows: Buckets,
    /// One per thread.
    sorters: Vec<Mutex<DepthSorter>>,
}

impl RowLists {
    /// Lists the records of the given ascending runs.
    pub(super) fn fill(&mut self, n_rows: usize, runs: &[Range<u32>], listings: &[DepthEntry]) {
        let n = runs.len().div_ceil(GROUPS * rayon::current_num_threads()).max(1);
        self.rows.fill_parallel(n_rows, runs, n, |record| listings[record as usize].tile_rows());
    }

    pub(super) fn sort(&mut self, listings: &[DepthEntry]) {
        let Self { rows, sorters } = self;
        let n_threads = rayon::current_num_threads().max(sorters.len());
        sorters.resize_with(n_threads, Mutex::default);
        let rows = rows.each_mut().into_iter().map(|row| (row.len(), row));
        longest_first(rows, |row| {
            // Each thread uses its own sorter, so the lock is never contended. It only avoids unsafe code.
            let thread = rayon::current_thread_index().unwrap_or(0) % sorters.len();
            let mut sorter = sorters[thread].lock().unwrap_or_else(PoisonError::into_inner);
            sorter.sort(row, |i| listings[i as usize].key);
        });
    }

    pub(super) fn get(&self, row: usize) -> &[u32] {
        self.rows.get(row)
    }
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
                rows.fill(5, &[0..1, 1..1, 1..4], &listings);
                rows.sort(&listings);
            });
            let lists: Vec<&[u32]> = (0..5).map(|row| rows.get(row)).collect();
            assert_eq!(lists, [&[3, 0, 2][..], &[3, 0], &[3, 1, 0], &[3], &[3]], "{n_threads}");
        }
    }
}
