//! Incremental update of the grid's order when few means move: entries to remove and entries to
//! insert, sorted by cell and component.

/// Removals and insertions in an ordered list of entries.
#[derive(Debug, Default)]
pub(in crate::train) struct Edits {
    /// Cell, component, and true for an insertion, false for a removal.
    moves: Vec<(u32, u32, bool)>,
    /// Old entry to remove (`None`) or to insert a component before (`Some`).
    insertions_and_removals: Vec<(u32, Option<u32>)>,
}

impl Edits {
    /// Finds the edits for components that move from the cells in `cell_of_id`, which is updated, to those
    /// given by `cell_of`. `cell` returns the first entry of a cell and its components, ascending.
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

    /// Shifts the first entries of cells (one more than the number of cells).
    pub fn shift_starts(&self, start: &mut [u32]) {
        let (mut from, mut shift) = (0, 0u32);
        for &(cell, _, comes) in &self.moves {
            let behind = cell as usize + 1;
            start[from..behind].iter_mut().for_each(|start| *start = start.wrapping_add(shift));
            from = behind;
            shift = shift.wrapping_add(if comes { 1 } else { u32::MAX });
        }
        start[from..].iter_mut().for_each(|start| *start = start.wrapping_add(shift));
    }

    /// Writes a table of entries in the new order from the old one; `of` gives the value of a moved
    /// component.
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
