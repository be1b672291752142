//! Splits the tiles of a pass into parallel tasks, each with the columns of its points.

use crate::observation::points::Points;
use crate::train::paper::index::PaperScalar;
use std::ops::Range;

/// Number of tiles per parallel task: about a thousand points.
const TILES_PER_TASK: usize = 16;

/// Results for the points of some tiles: effective distances and owners. `owners` is empty unless
/// requested.
pub(super) struct Columns<'a> {
    pub(super) q: &'a mut [f64],
    pub(super) owners: &'a mut [u32],
}

/// Splits tiles and the columns of their points into parallel tasks, and runs `task` for each.
pub(super) fn for_each_task<R: PaperScalar>(
    points: &Points<R>,
    tiles: Range<usize>,
    columns: Columns,
    task: &(impl Fn(Range<usize>, Columns) + Sync),
) {
    if tiles.is_empty() {
        return;
    }
    if tiles.len() <= TILES_PER_TASK {
        return task(tiles, columns);
    }
    // Halves are rounded to whole tasks, so that only the last one may be smaller.
    let middle = tiles.start + (tiles.len() / 2).next_multiple_of(TILES_PER_TASK);
    let n_points = (points.tiles[middle] - points.tiles[tiles.start]) as usize;
    let (left, right) = columns.split(n_points);
    rayon::join(
        || for_each_task(points, tiles.start..middle, left, task),
        || for_each_task(points, middle..tiles.end, right, task),
    );
}

/// Runs `task` for each of the given tiles, in ascending order, with the columns of the tile's points.
/// `columns` begin at point `first`.
pub(super) fn for_each_part<R: PaperScalar>(
    points: &Points<R>,
    tiles: &[u32],
    first: usize,
    columns: Columns,
    task: &(impl Fn(usize, Columns) + Sync),
) {
    let start_of = |tile: u32| points.tiles[tile as usize] as usize;
    if tiles.len() > TILES_PER_TASK {
        let (left, right) = tiles.split_at(tiles.len() / 2);
        let middle = start_of(right[0]);
        let (before, behind) = columns.split(middle - first);
        rayon::join(
            || for_each_part(points, left, first, before, task),
            || for_each_part(points, right, middle, behind, task),
        );
        return;
    }
    let (mut first, mut columns) = (first, columns);
    for &tile in tiles {
        let (_, from) = columns.split(start_of(tile) - first);
        let (own, later) = from.split(points.tile(tile as usize).len());
        task(tile as usize, own);
        (first, columns) = (points.tile(tile as usize).end, later);
    }
}

impl<'a> Columns<'a> {
    fn split(self, n_points: usize) -> (Columns<'a>, Columns<'a>) {
        let (q, later_q) = self.q.split_at_mut(n_points);
        // Owners that are not requested are empty.
        let (owners, later_owners) = self.owners.split_at_mut(n_points.min(self.owners.len()));
        (Columns { q, owners }, Columns { q: later_q, owners: later_owners })
    }
}
