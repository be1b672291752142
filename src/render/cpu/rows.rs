//! Visible records by row of tiles.
//!
//! Listed first and sorted by depth then, row by row: what is listed is read in the order in which it
//! lies in memory, lists of a row fit the caches, and all threads sort. Sorted first, the two steps
//! took twice as long for 10⁶ splats on two cores.

use super::longest_first::longest_first;
use super::record::DepthEntry;
use super::sort::DepthSorter;
use crate::math::pieces::pieces;
use rayon::prelude::*;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

/// Groups of runs for each thread: runs differ in how many records they hold.
const GROUPS: usize = 4;

/// Lists of records by row, the nearest first once they are sorted.
#[derive(Default)]
pub(super) struct RowLists {
    /// Where each row's list ends, and the next one begins.
    ends: Vec<usize>,
    records: Vec<u32>,
    /// One a thread.
    sorters: Vec<Mutex<DepthSorter>>,
}

impl RowLists {
    /// Lists records, which are given in ascending runs. Groups of runs are counted by row, and then each fills
    /// its part of every row's list.
    pub(super) fn fill(&mut self, n_rows: usize, runs: &[Range<u32>], listings: &[DepthEntry]) {
        let Self { ends, records, .. } = self;
        let n_groups = GROUPS * rayon::current_num_threads();
        let groups = runs.par_chunks(runs.len().div_ceil(n_groups).max(1)).with_max_len(1);
        let rows_of = |record: u32| listings[record as usize].tile_rows();
        let counts: Vec<Vec<usize>> =
            groups.clone().map(|runs| count(n_rows, runs, rows_of)).collect();
        // Row by row, and within a row by group.
        let sizes = (0..n_rows).flat_map(|row| counts.iter().map(move |of_rows| of_rows[row]));
        ends.clear();
        ends.extend((0..n_rows).scan(0, |end, row| {
            *end += counts.iter().map(|of_rows| of_rows[row]).sum::<usize>();
            Some(*end)
        }));
        records.resize(ends.last().copied().unwrap_or(0), 0);
        let mut parts: Vec<Vec<_>> = counts.iter().map(|_| Vec::with_capacity(n_rows)).collect();
        for (i, piece) in pieces(records, sizes).into_iter().enumerate() {
            parts[i % counts.len()].push(piece.iter_mut());
        }
        parts.into_par_iter().zip(groups).for_each(|(mut rows, runs)| {
            for record in runs.iter().cloned().flatten() {
                for row in &mut rows[rows_of(record)] {
                    // There are as many as were counted.
                    if let Some(place) = row.next() {
                        *place = record;
                    }
                }
            }
        });
    }

    /// Sorts every list by depth.
    pub(super) fn sort(&mut self, listings: &[DepthEntry]) {
        let Self { ends, records, sorters } = self;
        let n_threads = rayon::current_num_threads().max(sorters.len());
        sorters.resize_with(n_threads, Mutex::default);
        let sizes = ends.iter().scan(0, |start, &end| Some(end - std::mem::replace(start, end)));
        let rows = pieces(records, sizes).into_iter().map(|row| (row.len(), row));
        longest_first(rows, |row| {
            // Every thread takes its own, so the lock never waits: it is how safe code says so.
            let thread = rayon::current_thread_index().unwrap_or(0) % sorters.len();
            let mut sorter = sorters[thread].lock().unwrap_or_else(PoisonError::into_inner);
            sorter.sort(row, |i| listings[i as usize].key);
        });
    }

    /// Records of one row.
    pub(super) fn get(&self, row: usize) -> &[u32] {
        let start = if row == 0 { 0 } else { self.ends[row - 1] };
        &self.records[start..self.ends[row]]
    }
}

/// How many records touch each of so many rows.
fn count(n_rows: usize, runs: &[Range<u32>], rows_of: impl Fn(u32) -> Range<usize>) -> Vec<usize> {
    // One more: what begins and what ends at a row is counted, which takes no loop a record.
    let mut counts = vec![0usize; n_rows + 1];
    for record in runs.iter().cloned().flatten() {
        let Range { start, end } = rows_of(record);
        counts[start] = counts[start].wrapping_add(1);
        counts[end] = counts[end].wrapping_sub(1);
    }
    let mut touching = 0usize;
    for count in &mut counts {
        touching = touching.wrapping_add(*count);
        *count = touching;
    }
    counts
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
