//! Tiles of a pass: splits them into parallel tasks, each with the columns of its points; finds the tiles
//! within reach of a moved mean; and selects the valid records after these tiles were run again
//! (`training.md`, Reassignment).

use crate::math::simd::Isa;
use crate::model::conjugate::statistics::TileRecord;
use crate::observation::points::Points;
use crate::train::candidates;
use crate::train::candidates::{AnyWithin, MeanGrid};
use crate::train::paper::fused::FusedInputs;
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

#[derive(Default)]
pub(super) struct RerunTiles {
    /// For each tile, true if it was run again; empty if none were.
    pub is_again: Vec<bool>,
    /// Indices of the tiles that were run again, ascending.
    pub tiles: Vec<u32>,
    /// Positions that means left or moved to.
    pub places: MeanGrid,
}

/// Scratch memory of a thread for finding the tiles to run again.
#[derive(Default)]
pub(super) struct ReachMemory {
    near: candidates::Columns,
    tile: candidates::Columns,
    reach2: Vec<f32>,
}

impl RerunTiles {
    /// Returns the valid records, in slices. The first `n_first` records were made before tiles were
    /// run again; those of tiles that were run again are outdated and left out.
    pub fn valid_records<'a>(
        &'a self,
        records: &'a [TileRecord<f32>],
        n_first: usize,
    ) -> impl Iterator<Item = &'a [TileRecord<f32>]> {
        let (first, second) = records.split_at(n_first);
        let is_outdated = |record: &TileRecord<f32>| self.is_again[record.tile as usize];
        let runs = first.chunk_by(move |a, b| is_outdated(a) == is_outdated(b));
        runs.filter(move |run| !run.first().is_some_and(is_outdated)).chain([second])
    }
}

impl ReachMemory {
    /// True if any of `places` is within reach of a point of the tile: a mean at that place may receive
    /// part of the point, or may have received it.
    pub fn reaches(
        &mut self,
        inputs: &FusedInputs<'_>,
        tile: usize,
        q: &[f64],
        places: &MeanGrid,
    ) -> bool {
        let Self { near, tile: memory, reach2 } = self;
        let &FusedInputs { points, .. } = inputs;
        let range = points.tile(tile);
        let q = &q[range.clone()];
        // Without a score there is no radius; running the tile again is correct in any case.
        if q.iter().any(|q| q.is_nan()) {
            return true;
        }
        reach2.clear();
        reach2.extend(q.iter().map(|&q| inputs.influence_radius2(q)));
        let points = [&points.x, &points.y, &points.z].map(|column| &column[range.clone()]);
        Isa::best().run(AnyWithin { places, near, tile: memory, points, reach2 })
    }
}
