//! How the order of a grid's entries changes when few means move: entries that are left out and others
//! that are put in, in the order of cells and components.

/// Changes of an order of entries.
#[derive(Debug, Default)]
pub(in crate::train) struct Edits {
    /// Cell and component, and whether it comes to the cell or leaves it.
    moves: Vec<(u32, u32, bool)>,
    /// Entry of the old order that is left out or that something is put before, and what that is.
    places: Vec<(u32, Option<u32>)>,
}

impl Edits {
    /// Finds what changes when components move from the cells where `cell_of_id` has them, which hears
    /// of it, to those that `cell_of` names. `cell` is the first entry of a cell and the components in
    /// it, ascending.
    pub fn find<'a>(
        &mut self,
        moved: &[u32],
        cell_of_id: &mut [u32],
        cell_of: impl Fn(u32) -> u32,
        cell: impl Fn(u32) -> (u32, &'a [u32]),
    ) {
        let Self { moves, places } = self;
        moves.clear();
        for &id in moved {
            let now = cell_of(id);
            let before = std::mem::replace(&mut cell_of_id[id as usize], now);
            moves.extend([(before, id, false), (now, id, true)]);
        }
        // Whoever stays in a cell leaves it first.
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

    /// Moves the first entries of cells, one more than there are.
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

    /// Writes a table of the entries in their new order, given the old one; `of` is what a component
    /// that has moved gets.
    pub fn apply<T: Copy>(&self, old: &[T], new: &mut [T], of: impl Fn(u32) -> T) {
        let (mut from, mut to) = (0, 0);
        for &(at, comes) in &self.places {
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
