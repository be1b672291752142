//! Finds tiles within reach of a moved mean, and selects the valid records after these were run again
//! (`training.md`, Reassignment).

use crate::math::simd::Isa;
use crate::model::conjugate::statistics::TileRecord;
use crate::train::candidates::{AnyWithin, Columns, MeanGrid};
use crate::train::paper::fused::FusedInputs;

#[derive(Default)]
pub(super) struct RerunTiles {
    /// True for each tile that was run again; empty if none were.
    pub is_again: Vec<bool>,
    /// These tiles, ascending.
    pub tiles: Vec<u32>,
    /// Places that means left or moved to.
    pub places: MeanGrid,
}

/// Scratch memory of a thread for finding these tiles.
#[derive(Default)]
pub(super) struct ReachMemory {
    near: Columns,
    tile: Columns,
    reach2: Vec<f32>,
}

impl RerunTiles {
    /// Selects the valid records, in slices. Of the first `n_first` records, made before tiles were run
    /// again, those of such tiles are outdated.
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
    /// True if a place is within reach of a point of the tile: near enough for its mean to receive, or to
    /// have received, part of the point.
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
