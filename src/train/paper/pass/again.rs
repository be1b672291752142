//! Runs selected tiles of a frame: those that a device left open, and those run again because a mean
//! has moved within reach of their points (`train.md`, Reassignment).

use super::reached::RerunTiles;
use super::tasks::{Columns, for_each_part};
use super::{Output, Pass, Worker};
use crate::math::simd::Isa;
use crate::train::paper::fused::{FusedInputs, FusedTiles};
use rayon::prelude::*;
use std::sync::PoisonError;

/// Number of tiles tested per parallel task.
const PART: usize = 64;

impl Pass {
    /// Runs those tiles of the last pass again that are within reach of `places`, which means have left or
    /// moved to since. Returns their number. The result equals a full pass.
    pub(in crate::train::paper) fn run_reached(
        &mut self,
        inputs: &FusedInputs<'_>,
        places: &[[f32; 3]],
        q: &mut [f64],
        owners: Option<&mut Vec<u32>>,
    ) -> usize {
        let mut again = std::mem::take(&mut self.again);
        self.find_reached(inputs, places, q, &mut again);
        for worker in &mut self.workers {
            let worker = worker.get_mut().unwrap_or_else(PoisonError::into_inner);
            worker.first_run.clear();
            worker.first_run.extend(worker.narrow.iter().map(Vec::len));
        }
        let owners = owners.map_or(&mut [][..], |owners| owners);
        self.run_some(inputs, &again.tiles, Output::ElboAndSums, q, owners);
        self.again = again;
        self.again.tiles.len()
    }

    fn find_reached(
        &self,
        inputs: &FusedInputs<'_>,
        places: &[[f32; 3]],
        q: &[f64],
        again: &mut RerunTiles,
    ) {
        let RerunTiles { is_again, tiles, places: grid } = again;
        is_again.clear();
        // If no grid can hold the places, all tiles count as reached.
        is_again.resize(inputs.points.n_tiles(), grid.rebuild(places).is_err());
        let parts = is_again.par_chunks_mut(PART).enumerate();
        parts.for_each(|(part, is_again)| {
            let mut worker = self.worker();
            for (tile, is_again) in (part * PART..).zip(is_again) {
                *is_again = *is_again || worker.reach.reaches(inputs, tile, q, grid);
            }
        });
        tiles.clear();
        tiles.reserve(is_again.len());
        tiles
            .extend((0..).zip(&*is_again).filter(|(_, is_again)| **is_again).map(|(tile, _)| tile));
    }

    /// Runs the given tiles, ascending and unique. `q` and, if requested, `owners` cover all points.
    pub(in crate::train::paper) fn run_some(
        &self,
        inputs: &FusedInputs<'_>,
        tiles: &[u32],
        output: Output,
        q: &mut [f64],
        owners: &mut [u32],
    ) {
        let columns = Columns { ids: &mut [], scores: &mut [], q, owners };
        for_each_part(inputs.points, tiles, 0, columns, &|tile, columns| {
            let mut worker = self.worker();
            let Worker { fused: memory, narrow, clock, .. } = &mut *worker;
            let records = (output == Output::ElboAndSums).then_some(&mut narrow[..]);
            let (inputs, tiles, Columns { q, owners, .. }) = (*inputs, tile..tile + 1, columns);
            Isa::best().run(FusedTiles { inputs, memory, tiles, q, owners, records, clock });
        });
    }
}
