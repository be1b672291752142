//! Which tiles of a frame a moved mean reaches, and which records count when those were run again
//! (`train.md`, Reassignment).

use crate::math::simd::Isa;
use crate::model::conjugate::statistics::TileRecord;
use crate::train::candidates::{AnyWithin, Columns, MeanGrid};
use crate::train::paper::fused::FusedInputs;

/// Tiles that were run again, and how they are found.
#[derive(Default)]
pub(super) struct Again {
    /// By tile whether it was run again; empty if none was.
    pub is_again: Vec<bool>,
    /// The tiles, ascending.
    pub tiles: Vec<u32>,
    /// Places that means left or came to.
    pub places: MeanGrid,
}

/// Memory of a thread that looks for the tiles.
#[derive(Default)]
pub(super) struct ReachMemory {
    near: Columns,
    tile: Columns,
    reach2: Vec<f32>,
}

impl Again {
    /// Forgets which tiles were run again.
    pub fn clear(&mut self) {
        self.is_again.clear();
    }

    /// The records that count of those in `records`, in slices: of tiles that were run again those behind
    /// the first `n_first`, which were there before.
    pub fn counted<'a>(
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
    /// Whether any of `places` is within reach of a point of a tile: near enough to receive something
    /// of it, or to have received something.
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
        if q.iter().any(|q| q.is_nan()) {
            return true;
        }
        reach2.clear();
        reach2.extend(q.iter().map(|&q| inputs.reach2(q)));
        let points = [&points.x, &points.y, &points.z].map(|column| &column[range.clone()]);
        Isa::best().run(AnyWithin { places, near, tile: memory, points, reach2 })
    }
}
