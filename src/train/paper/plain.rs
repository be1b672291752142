//! Reference implementation of a pass: candidates, scores, responsibilities and sums in sequence, each
//! in the configured precision. Also used for dense E-steps.
//!
//! Every stage is a function over one tile with its own precision. So `precision-search` can vary one
//! operation at a time. Not optimised: its results define those of the faster implementations.

use super::config::{Candidates, Operations, Width};
use super::fused::Slots;
use super::index::{PaperScalar, narrow};
use super::pass::{Mixture, PassInputs};
use crate::math::real::Real;
use crate::math::simd::Isa;
use crate::model::conjugate::statistics::{N_SUMS, TileRecord, add_point};
use crate::observation::points::Points;
use crate::train::candidates::{CandidateSearch, nearest_in_tile, nearest_in_tile_wide};
use crate::train::component_elbo::owner_of_shares;
use std::num::NonZero;
use std::ops::Range;

#[derive(Clone, Copy)]
pub(super) struct PlainInputs<'a, R: PaperScalar> {
    pub pass: PassInputs<'a, R>,
    pub points: &'a Points<R>,
}

/// Scratch memory of a thread, reused between tiles.
#[derive(Default)]
pub(super) struct PlainMemory {
    search: CandidateSearch,
    pub slots: Slots,
    pub ids_by_slot: Vec<u32>,
    pub narrow_sums: Vec<[f32; N_SUMS]>,
    pub wide_sums: Vec<[f64; N_SUMS]>,
}

impl<R: PaperScalar> PlainInputs<'_, R> {
    /// Number of candidates per point.
    pub fn per_point(&self) -> usize {
        let n_components = self.pass.mixture.model.len();
        match self.pass.candidates {
            Candidates::Dense => n_components,
            Candidates::Nearest(n) => n.min(n_components),
        }
    }

    pub fn operations(&self) -> Operations {
        self.pass.mixture.config.operations
    }

    /// Fills `ids` with the candidates of the points in `range`, which form a tile.
    pub fn find(&self, memory: &mut PlainMemory, range: Range<usize>, ids: &mut Vec<u32>) {
        let PassInputs { mixture, candidates } = self.pass;
        let (points, space) = (self.points, &mixture.model.space);
        ids.clear();
        let Candidates::Nearest(n) = candidates else {
            return range.for_each(|_| ids.extend(0..space.len() as u32));
        };
        let Some(n) = NonZero::new(n) else { return };
        let (grid, search) = (&mixture.sorted().grid, &mut memory.search);
        match narrow::<_, Points<f32>>(points) {
            // Distances in f32 require points and means stored in f32.
            Some(points) if self.operations().distance == Width::F32 => {
                let tile = [&points.x[range.clone()], &points.y[range.clone()], &points.z[range]];
                nearest_in_tile(Isa::best(), grid, search, tile, n, ids);
            }
            _ => nearest_in_tile_wide(grid, search, space, points, range, n, ids),
        }
    }

    /// Computes the scores of the points in `range` against their candidates `ids`.
    pub fn score(&self, range: Range<usize>, ids: &[u32], scores: &mut [f64]) {
        match self.operations().log_score {
            Width::F32 => self.score_in::<f32>(range, ids, scores),
            Width::F64 => self.score_in::<f64>(range, ids, scores),
        }
    }

    fn score_in<S: Real>(&self, range: Range<usize>, ids: &[u32], scores: &mut [f64]) {
        let Mixture { model, scoring, .. } = self.pass.mixture;
        // A model without components has no candidates, and chunks of 0 would panic.
        let per_point = self.per_point().max(1);
        let of_points = ids.chunks_exact(per_point).zip(scores.chunks_exact_mut(per_point));
        for (i, (ids, scores)) in range.zip(of_points) {
            let (space, color) = (self.points.position(i), self.points.color(i));
            for (&id, score) in ids.iter().zip(scores) {
                let q: S = scoring.distance(model, id as usize, space, color);
                *score = q.to_f64();
            }
        }
    }

    /// Converts scores to responsibilities in place and writes effective distances to `q`. Points with a
    /// NaN score get NaN and zero responsibilities.
    pub fn normalise(&self, scores: &mut [f64], q: &mut [f64]) {
        let (scoring, per_point) = (&self.pass.mixture.scoring, self.per_point().max(1));
        for (scores, q) in scores.chunks_exact_mut(per_point).zip(q) {
            *q = match self.operations().normaliser {
                Width::F32 => scoring.responsibilities::<f32>(scores),
                Width::F64 => scoring.responsibilities::<f64>(scores),
            };
            if !q.is_finite() {
                *q = f64::NAN;
                // Zeros, because NaN would spoil the sums of every candidate.
                scores.fill(0.0);
            }
        }
    }

    /// Writes the component with the largest responsibility for each point to `owners`; the first if
    /// several are equal. It is `NO_OWNER` if all responsibilities are zero.
    pub fn find_owners(&self, ids: &[u32], responsibilities: &[f64], owners: &mut [u32]) {
        let per_point = self.per_point().max(1);
        let of_points = ids.chunks_exact(per_point).zip(responsibilities.chunks_exact(per_point));
        for ((ids, responsibilities), owner) in of_points.zip(owners) {
            *owner = owner_of_shares(ids.iter().copied().zip(responsibilities.iter().copied()));
        }
    }

    /// Sums the points of a tile in order. Appends one record for each component that receives any of
    /// them.
    pub fn sum<M: Real>(
        &self,
        slots: &mut Slots,
        ids_by_slot: &mut Vec<u32>,
        sums: &mut Vec<[M; N_SUMS]>,
        tile: usize,
        (ids, responsibilities): (&[u32], &[f64]),
        records: &mut [Vec<TileRecord<M>>],
    ) {
        let Mixture { model, statistics, .. } = self.pass.mixture;
        let of = |v: R| M::of(v.to_f64());
        let per_point = self.per_point().max(1);
        slots.begin(model.len());
        ids_by_slot.clear();
        sums.clear();
        let of_points = ids.chunks_exact(per_point).zip(responsibilities.chunks_exact(per_point));
        for (i, (ids, responsibilities)) in self.points.tile(tile).zip(of_points) {
            let (space, color) = (self.points.position(i).map(of), self.points.color(i).map(of));
            // A point adds one term to each of its candidates, so their order does not affect sums.
            for (&id, &r) in ids.iter().zip(responsibilities).filter(|(_, r)| **r > 0.0) {
                // Zero shares are filtered above: they would create empty records.
                let slot = slots.find(id);
                if slot == sums.len() {
                    ids_by_slot.push(id);
                    sums.push([M::ZERO; N_SUMS]);
                }
                let mean = model.space[id as usize].map(of);
                let d = std::array::from_fn(|axis| space[axis] - mean[axis]);
                add_point(&mut sums[slot], M::of(r), d, color);
            }
        }
        for (&id, &sums) in ids_by_slot.iter().zip(sums.iter()) {
            let record = TileRecord { id, tile: tile as u32, sums };
            records[id as usize >> statistics.shard_bits()].push(record);
        }
    }
}
