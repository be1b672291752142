//! Lists of visible records per row of tiles.
//!
//! Records are listed first and then sorted by depth, row by row. Listing thus reads memory sequentially,
//! the lists of a row fit the caches, and all threads sort. In the opposite order both steps took twice as
//! long for 10⁶ splats on two cores.

use super::buckets::Buckets;
use super::prepare;
use super::prepare::ChunkCount;
use super::record::{DepthEntry, Records};
use super::textures::LatticeOf;
use super::view::CpuView;
use crate::model::splat::appearance::SplatView;
use crate::render::options::TILE;
use std::ops::Range;
use std::sync::{Mutex, PoisonError};

// Groups of runs per thread, for load balancing: runs differ in their number of records.
const GROUPS: usize = 4;

/// Records of a view, and lists of them by row of tiles. Buffers are reused between views.
#[derive(Default)]
pub(super) struct ViewLists {
    pub records: Records,
    depth_entries: Vec<DepthEntry>,
    counts: Vec<ChunkCount>,
    /// Visible records per row of tiles, nearest first after sorting. Lists per row remain short even if
    /// every splat covers the image, and rows bin their own tiles in parallel.
    pub rows: Buckets,
    /// Buffers for sorting, one instance per thread.
    sorters: Vec<DepthSorter>,
}

impl ViewLists {
    /// Converts the splats to records, with the planes of splats for which `lattices` returns a lattice.
    /// Returns the number of invalid splats.
    pub(super) fn prepare(
        &mut self,
        splats: SplatView<'_>,
        view: &CpuView,
        lattices: Option<LatticeOf<'_>>,
    ) -> usize {
        prepare::prepare(
            splats,
            view,
            lattices,
            &mut self.records,
            &mut self.depth_entries,
            &mut self.counts,
        );
        self.counts.iter().map(|count| count.n_invalid).sum()
    }

    /// Lists the visible records per row of tiles; `height` is the image height in pixels.
    pub(super) fn bin(&mut self, height: usize) {
        let runs: Vec<Range<u32>> = self.visible_runs().collect();
        let n = runs.len().div_ceil(GROUPS * rayon::current_num_threads()).max(1);
        let Self { rows, depth_entries, .. } = self;
        let touched = |record: u32| depth_entries[record as usize].tile_rows();
        rows.fill_parallel(height.div_ceil(TILE), &runs, n, touched);
    }

    pub(super) fn sort(&mut self) {
        let Self { rows, sorters, depth_entries, .. } = self;
        let rows = rows.each_mut().into_iter().map(|row| (row.len(), row));
        longest_first(rows, sorters, |row, sorter: &mut DepthSorter| {
            sorter.sort(row, |i| depth_entries[i as usize].key);
        });
    }

    pub(super) fn n_visible(&self) -> usize {
        self.counts.iter().map(|count| count.n_visible).sum()
    }

    /// Iterates over ranges of visible records in the order of their splats. Each chunk of
    /// [`prepare::CHUNK`] splats has one range, which starts at the chunk's first index.
    pub(super) fn visible_runs(&self) -> impl Iterator<Item = Range<u32>> {
        let firsts = (0..).step_by(prepare::CHUNK);
        self.counts.iter().zip(firsts).map(|(count, first)| first..first + count.n_visible as u32)
    }
}

/// Runs tasks in parallel, largest work estimate first, each with the buffer of its thread. Only short tasks
/// remain at the end, so threads finish at about the same time.
pub(super) fn longest_first<T: Send, B: Default + Send>(
    tasks: impl Iterator<Item = (usize, T)>,
    buffers: &mut Vec<B>,
    run: impl Fn(T, &mut B) + Sync,
) {
    let mut tasks: Vec<(usize, T)> = tasks.collect();
    // Ascending, because `pop` takes the last task.
    tasks.sort_by_key(|(work, _)| *work);
    let tasks = Mutex::new(tasks);
    let next = || tasks.lock().unwrap_or_else(PoisonError::into_inner).pop();
    buffers.resize_with(rayon::current_num_threads(), B::default);
    let (next, run) = (&next, &run);
    rayon::scope(|scope| {
        // One loop per thread: rayon would not start separate tasks in this order.
        for buffer in buffers {
            scope.spawn(move |_| {
                while let Some((_, task)) = next() {
                    run(task, buffer);
                }
            });
        }
    });
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Keyed {
    /// Bits of a positive `f32`, which have the same order as the values.
    key: u32,
    record: u32,
}

// Bits per pass. Three passes cover the 31 bits of a positive `f32`, and 2¹¹ counters fit L1.
const DIGIT_BITS: u32 = 11;
const N_DIGITS: usize = 1 << DIGIT_BITS;
const N_PASSES: usize = 3;
// Shorter lists use a comparison sort: they have fewer items than a pass has counters.
const MIN_RADIX_LENGTH: usize = 1024;

/// Least-significant-digit radix sort with reusable buffers.
#[derive(Default)]
pub(super) struct DepthSorter {
    items: Vec<Keyed>,
    buffer: Vec<Keyed>,
}

impl DepthSorter {
    /// Sorts an ascending list of records stably by depth; depths must be positive.
    pub(super) fn sort(&mut self, records: &mut [u32], depth: impl Fn(u32) -> f32) {
        let Self { items, buffer } = self;
        items.clear();
        let keyed = |&record: &u32| Keyed { key: depth(record).to_bits(), record };
        items.extend(records.iter().map(keyed));
        if items.len() < MIN_RADIX_LENGTH {
            // The record breaks ties, which gives the stable order of the radix sort.
            items.sort_unstable_by_key(|item| (item.key, item.record));
        } else {
            // One loop counts the digits of all passes, because reordering leaves the counts unchanged.
            let mut starts = digit_starts(items);
            buffer.resize(items.len(), Keyed::default());
            for (pass, starts) in starts.iter_mut().enumerate() {
                for &item in items.iter() {
                    let start = &mut starts[digit(item.key, pass)];
                    buffer[*start as usize] = item;
                    *start += 1;
                }
                std::mem::swap(items, buffer);
            }
        }
        records.iter_mut().zip(items).for_each(|(record, item)| *record = item.record);
    }
}

#[inline(always)]
fn digit(key: u32, pass: usize) -> usize {
    (key >> (pass as u32 * DIGIT_BITS)) as usize & (N_DIGITS - 1)
}

fn digit_starts(items: &[Keyed]) -> [[u32; N_DIGITS]; N_PASSES] {
    let mut counts = [[0; N_DIGITS]; N_PASSES];
    for item in items {
        for (pass, counts) in counts.iter_mut().enumerate() {
            counts[digit(item.key, pass)] += 1;
        }
    }
    for counts in &mut counts {
        let mut start = 0;
        for count in counts {
            start += std::mem::replace(count, start);
        }
    }
    counts
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn every_task_runs_once_and_the_longest_first() {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        let ran = Mutex::new(Vec::new());
        let tasks = [3, 0, 7, 7, 1].into_iter().map(|work| (work, work));
        pool.install(|| {
            longest_first(tasks, &mut vec![(); 0], |task, ()| ran.lock().unwrap().push(task))
        });
        assert_eq!(*ran.lock().unwrap(), [7, 7, 3, 1, 0]);
    }

    proptest! {
        #[test]
        fn agrees_with_the_stable_sort_of_the_standard_library(
            depths in proptest::collection::vec(prop_oneof![0f32..1e-30, 0.2f32..9.0, Just(1.5), 1e20f32..3e38], 0..300),
            times in prop_oneof![Just(1), Just(20)],
        ) {
            let depth = |record: u32| depths[record as usize % depths.len()];
            let mut sorted: Vec<u32> = (0..(times * depths.len()) as u32).collect();
            let mut expected = sorted.clone();
            expected.sort_by(|&a, &b| depth(a).total_cmp(&depth(b)));
            DepthSorter::default().sort(&mut sorted, depth);
            prop_assert_eq!(sorted, expected);
        }
    }
}
