//! Finds the tiles within reach of a moved mean, and selects the valid records after these tiles were
//! run again (`training.md`, Reassignment).

use crate::math::simd::Isa;
use crate::model::conjugate::statistics::TileRecord;
use crate::train::candidates::{AnyWithin, Columns, MeanGrid};
use crate::train::paper::fused::FusedInputs;

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
    near: Columns,
    tile: Columns,
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
