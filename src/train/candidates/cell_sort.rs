//! Counting sort of ids by cell; ids in a cell ascend.
//!
//! If there are enough threads, it takes two parallel steps. The first sorts parts of the ids into
//! ranges of cells, the second sorts each range into its cells. With two threads, this is no faster
//! than one sequential step.

use rayon::prelude::*;
use std::ops::Range;

// Number of threads from which two parallel steps are faster (`training.md`, Speed).
const MANY: usize = 4;
// Number of parts of the ids. Fixed rather than one per thread, so memory grows only once.
const PARTS: usize = 16;
/// Number of ranges of consecutive cells. Ids are first sorted into these ranges.
const RANGES: usize = 64;

/// Sorts ids by cell; buffers are reused.
#[derive(Debug, Default)]
pub(super) struct CellSort {
    parts: [Part; PARTS],
}

/// Part of the ids, sorted by range of cells.
#[derive(Debug, Default)]
struct Part {
    /// Pairs of cell and id, sorted by range of cells.
    entries: Vec<(u32, u32)>,
    /// Range `r` holds `entries[starts[r]..starts[r + 1]]`.
    starts: Vec<u32>,
}

impl CellSort {
    /// Sorts the indices of `cell_of_id` by cell and writes them to `ids`. Fills `start` with the
    /// position in `ids` of each cell's first index, then the total.
    pub fn sort(
        &mut self,
        cell_of_id: &[u32],
        n_cells: usize,
        start: &mut Vec<u32>,
        ids: &mut [u32],
    ) {
        if rayon::current_num_threads() < MANY {
            return counting_sort(cell_of_id, 0, n_cells, start, |to, id| ids[to] = id as u32);
        }
        start.resize(n_cells + 1, 0);
        let (cells, end) = start.split_at_mut(n_cells);
        end.fill(ids.len() as u32);
        // A power of two, so that a shift gives a cell's range.
        let width = n_cells.div_ceil(RANGES).next_power_of_two();
        // With few ids the last parts are empty.
        let size = cell_of_id.len().div_ceil(PARTS).max(1);
        self.parts.par_iter_mut().enumerate().for_each(|(i, part)| {
            let first = (i * size).min(cell_of_id.len());
            let last = (first + size).min(cell_of_id.len());
            part.fill(first as u32, &cell_of_id[first..last], width.ilog2());
        });
        Ranges { parts: &self.parts, width }.fill(0..RANGES, 0, cells, ids);
    }
}

/// Sorts the indices of `cells` by range of `2^shift` cells; indices in a range ascend. Calls
/// `put(to, index)` with the sorted position `to` of each index. Fills `start` with the position of each
/// range's first index, then the total.
fn counting_sort(
    cells: &[u32],
    shift: u32,
    n_ranges: usize,
    start: &mut Vec<u32>,
    mut put: impl FnMut(usize, usize),
) {
    start.clear();
    // Counts are stored two slots late and summed one slot late: filling a range then advances the next
    // range's start to its final value.
    start.resize(n_ranges + 2, 0);
    cells.iter().for_each(|&cell| start[(cell >> shift) as usize + 2] += 1);
    prefix_sum(0, start);
    for (place, &cell) in cells.iter().enumerate() {
        let next = &mut start[(cell >> shift) as usize + 1];
        put(*next as usize, place);
        *next += 1;
    }
    start.truncate(n_ranges + 1);
}

impl Part {
    /// Sorts ids into ranges of `2^shift` cells. The ids are consecutive from `first`; `cells` holds
    /// the cell of each.
    fn fill(&mut self, first: u32, cells: &[u32], shift: u32) {
        let Self { entries, starts } = self;
        entries.resize(cells.len(), (0, 0));
        let put = |to: usize, place: usize| entries[to] = (cells[place], first + place as u32);
        counting_sort(cells, shift, RANGES, starts, put);
    }

    fn of_ranges(&self, ranges: Range<usize>) -> &[(u32, u32)] {
        &self.entries[self.starts[ranges.start] as usize..self.starts[ranges.end] as usize]
    }
}

/// Merges the sorted parts of all ids, range by range.
#[derive(Clone, Copy)]
struct Ranges<'a> {
    parts: &'a [Part; PARTS],
    /// Number of cells in a range.
    width: usize,
}

impl Ranges<'_> {
    /// Fills `start` and `ids` for the given ranges of cells; `first` is the position of their first
    /// id. Both halves of `ranges` are processed in parallel.
    fn fill(self, ranges: Range<usize>, first: u32, start: &mut [u32], ids: &mut [u32]) {
        if ranges.len() == 1 {
            return self.fill_one(ranges.start, first, start, ids);
        }
        let middle = ranges.start.midpoint(ranges.end);
        let before = ranges.start..middle;
        // The last ranges may extend beyond the cells.
        let n_cells = (before.len() * self.width).min(start.len());
        let n = self.parts.iter().map(|part| part.of_ranges(before.clone()).len()).sum();
        let ((start, start_behind), (ids, ids_behind)) =
            (start.split_at_mut(n_cells), ids.split_at_mut(n));
        rayon::join(
            || self.fill(before, first, start, ids),
            || self.fill(middle..ranges.end, first + n as u32, start_behind, ids_behind),
        );
    }

    fn fill_one(self, range: usize, first: u32, start: &mut [u32], ids: &mut [u32]) {
        let entries = || self.parts.iter().flat_map(|part| part.of_ranges(range..range + 1));
        let place = |cell: u32| cell as usize - range * self.width;
        start.fill(0);
        entries().for_each(|&(cell, _)| start[place(cell)] += 1);
        prefix_sum(first, start);
        // Holds the ends of cells, which become starts as cells are filled from the back.
        entries().rev().for_each(|&(cell, id)| {
            let next = &mut start[place(cell)];
            *next -= 1;
            ids[(*next - first) as usize] = id;
        });
    }
}

/// Replaces each number by the sum of `sum` and all numbers up to and including it.
fn prefix_sum(mut sum: u32, numbers: &mut [u32]) {
    for number in numbers {
        sum += *number;
        *number = sum;
    }
}

/// Removals and insertions that keep entries ordered by cell after some components have moved.
#[derive(Debug, Default)]
pub(in crate::train) struct Edits {
    /// A cell, a component and a flag: true if the component is inserted into the cell, false if it is
    /// removed.
    moves: Vec<(u32, u32, bool)>,
    /// Index in the old list, and the component to insert before that entry; `None` removes the entry.
    insertions_and_removals: Vec<(u32, Option<u32>)>,
}

impl Edits {
    /// Finds the edits for the `moved` components and updates their cells in `cell_of_id`. `cell_of`
    /// returns the new cell of a component. `cell` returns the first entry of a cell and its components,
    /// ascending.
    pub fn find<'a>(
        &mut self,
        moved: &[u32],
        cell_of_id: &mut [u32],
        cell_of: impl Fn(u32) -> u32,
        cell: impl Fn(u32) -> (u32, &'a [u32]),
    ) {
        let Self { moves, insertions_and_removals: places } = self;
        moves.clear();
        for &id in moved {
            let now = cell_of(id);
            let before = std::mem::replace(&mut cell_of_id[id as usize], now);
            moves.extend([(before, id, false), (now, id, true)]);
        }
        // Removals sort before insertions, also for a component that remains in its cell.
        moves.sort_unstable();
        places.clear();
        places.extend(moves.iter().map(|&(of, id, comes)| {
            let (first, ids) = cell(of);
            match comes {
                false => (first + ids.partition_point(|&other| other < id) as u32, None),
                true => (first + ids.partition_point(|&other| other <= id) as u32, Some(id)),
            }
        }));
    }

    /// Updates `start`, the first entry of each cell and the total, after the edits.
    pub fn shift_starts(&self, start: &mut [u32]) {
        let (mut from, mut shift) = (0, 0u32);
        for &(cell, _, comes) in &self.moves {
            let behind = cell as usize + 1;
            start[from..behind].iter_mut().for_each(|start| *start = start.wrapping_add(shift));
            from = behind;
            // Negative shifts wrap, which additions undo.
            shift = shift.wrapping_add(if comes { 1 } else { u32::MAX });
        }
        start[from..].iter_mut().for_each(|start| *start = start.wrapping_add(shift));
    }

    /// Copies a table with one value per entry from `old` to `new`, applying the edits. `of` returns
    /// the value of a moved component.
    pub fn apply<T: Copy>(&self, old: &[T], new: &mut [T], of: impl Fn(u32) -> T) {
        let (mut from, mut to) = (0, 0);
        for &(at, comes) in &self.insertions_and_removals {
            let kept = at as usize - from;
            new[to..to + kept].copy_from_slice(&old[from..from + kept]);
            (from, to) = (from + kept, to + kept);
            match comes {
                None => from += 1,
                Some(id) => {
                    new[to] = of(id);
                    to += 1;
                }
            }
        }
        new[to..].copy_from_slice(&old[from..]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    #[test]
    fn ids_come_in_the_order_of_cells_and_ascend_in_each() {
        let mut rng = Rng::new(4, Purpose::Init, 0);
        for threads in [1, MANY] {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let mut sort = CellSort::default();
            for (n, n_cells) in
                [(0, 0), (0, 5), (1, 1), (40, 3), (1000, 1), (3000, 64), (3000, 70_001)]
            {
                let cells: Vec<u32> = (0..n).map(|_| rng.below(n_cells) as u32).collect();
                let (mut start, mut ids) = (vec![7; 50], vec![u32::MAX; n]);
                pool.install(|| sort.sort(&cells, n_cells, &mut start, &mut ids));
                let mut expected: Vec<u32> = (0..n as u32).collect();
                expected.sort_by_key(|&id| cells[id as usize]);
                assert_eq!(ids, expected, "{threads} {n} {n_cells}");
                for (cell, ends) in start.windows(2).enumerate() {
                    let these = &ids[ends[0] as usize..ends[1] as usize];
                    assert!(these.iter().all(|&id| cells[id as usize] == cell as u32));
                }
                assert_eq!((start[0], start[n_cells], start.len()), (0, n as u32, n_cells + 1));
            }
        }
    }
}
