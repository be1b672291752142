//! Splits a pass into tasks of tiles with the columns of their points.

use crate::observation::points::Points;
use crate::train::paper::config::Batch;
use crate::train::paper::index::PaperScalar;
use std::ops::Range;

/// Number of tiles per task: about a thousand points.
const TILES_PER_TASK: usize = 16;

/// Data of the points of some tiles. `ids` and `scores` are empty unless materialised, `owners` unless
/// requested.
pub(super) struct Columns<'a> {
    pub(super) ids: &'a mut [u32],
    pub(super) scores: &'a mut [f64],
    pub(super) q: &'a mut [f64],
    pub(super) owners: &'a mut [u32],
}

/// End of the batch that starts at `tile`.
pub(super) fn batch_end<R: PaperScalar>(points: &Points<R>, tile: usize, batch: Batch) -> usize {
    let Batch::Points(n) = batch else { return points.n_tiles() };
    let end = points.tiles[tile] as usize + n;
    let tiles_before = points.tiles.partition_point(|&start| (start as usize) < end);
    // At least one tile, or batches smaller than a tile would never advance.
    tiles_before.clamp(tile + 1, points.n_tiles())
}

/// Splits tiles and their columns into parallel tasks; `ids` and `scores` have `per_point` entries per point.
pub(super) fn for_each_task<R: PaperScalar>(
    points: &Points<R>,
    tiles: Range<usize>,
    per_point: usize,
    columns: Columns,
    task: &(impl Fn(Range<usize>, Columns) + Sync),
) {
    if tiles.len() <= TILES_PER_TASK {
        return task(tiles, columns);
    }
    // Halves are rounded to whole tasks, so that only the last one may be smaller.
    let middle = tiles.start + (tiles.len() / 2).next_multiple_of(TILES_PER_TASK);
    let n_points = (points.tiles[middle] - points.tiles[tiles.start]) as usize;
    let (left, right) = columns.split(n_points, per_point);
    rayon::join(
        || for_each_task(points, tiles.start..middle, per_point, left, task),
        || for_each_task(points, middle..tiles.end, per_point, right, task),
    );
}

/// Runs a task for each of some ascending tiles, with its columns; columns begin at point `first`.
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
        let (before, behind) = columns.split(middle - first, 0);
        rayon::join(
            || for_each_part(points, left, first, before, task),
            || for_each_part(points, right, middle, behind, task),
        );
        return;
    }
    let (mut first, mut columns) = (first, columns);
    for &tile in tiles {
        let (_, from) = columns.split(start_of(tile) - first, 0);
        let (own, later) = from.split(points.tile(tile as usize).len(), 0);
        task(tile as usize, own);
        (first, columns) = (points.tile(tile as usize).end, later);
    }
}

/// Runs a function for each tile, with its columns.
pub(super) fn for_each_tile<R: PaperScalar>(
    points: &Points<R>,
    tiles: Range<usize>,
    per_point: usize,
    mut columns: Columns,
    mut run: impl FnMut(usize, Columns),
) {
    for tile in tiles {
        let (own, rest) = columns.split(points.tile(tile).len(), per_point);
        columns = rest;
        run(tile, own);
    }
}

impl<'a> Columns<'a> {
    pub(super) fn reborrow(&mut self) -> Columns<'_> {
        let Self { ids, scores, q, owners } = self;
        Columns { ids, scores, q, owners }
    }

    fn split(self, n_points: usize, per_point: usize) -> (Columns<'a>, Columns<'a>) {
        let (ids, later_ids) = self.ids.split_at_mut(n_points * per_point);
        let (scores, later_scores) = self.scores.split_at_mut(n_points * per_point);
        let (q, later_q) = self.q.split_at_mut(n_points);
        let (owners, later_owners) = self.owners.split_at_mut(n_points.min(self.owners.len()));
        let later =
            Columns { ids: later_ids, scores: later_scores, q: later_q, owners: later_owners };
        (Columns { ids, scores, q, owners }, later)
    }
}
