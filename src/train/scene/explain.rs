//! Comparison of a frame's points with the scene before they are summed: distance from the seed, and most
//! probable position along the ray.
//!
//! Both share one pass, which is as much bound by memory as by arithmetic.

use super::component_sums::ComponentSums;
use super::grid::{NONE, squared_distance};
use super::refine::RefinementPlane;
use super::seed_positions::SeedPositions;
use super::spacing::Spacing;
use super::sum_scalar::SumScalar;
use crate::observation::surface::{DepthTolerance, SurfacePoint};
use rayon::prelude::*;

/// Points per task.
const CHUNK: usize = 1024;

pub struct Explainer<'a, W> {
    /// Sums of components that existed before the frame.
    pub component_sums: &'a ComponentSums<W>,
    pub seed_positions: SeedPositions<'a>,
    /// Structural scale, world units.
    pub h: f64,
    pub spacing: Spacing,
    pub tolerance: DepthTolerance,
    pub refines: bool,
}

impl<W: SumScalar> Explainer<'_, W> {
    /// Replaces `q` by the squared distance of each point from its owner's seed (world units², NaN without
    /// owner), and `shifts` by its movement along the ray (world units). Returns the sum of `q` and the
    /// number of points with an owner.
    pub fn explain(
        &self,
        points: &[SurfacePoint],
        owners: &[u32],
        q: &mut Vec<f64>,
        shifts: &mut Vec<f32>,
    ) -> (f64, usize) {
        q.resize(points.len(), 0.0);
        shifts.resize(points.len(), 0.0);
        let found = q.par_chunks_mut(CHUNK).zip(shifts.par_chunks_mut(CHUNK));
        let parts = points.par_chunks(CHUNK).zip(owners.par_chunks(CHUNK)).zip(found);
        let part = parts.map(|((points, owners), (q, shifts))| {
            self.explain_part(points, owners, q, shifts);
            let known = q.iter().filter(|q| !q.is_nan());
            known.fold((0.0, 0), |(sum, n), q| (sum + q, n + 1))
        });
        // Parts of fixed size, added in order: rounding is independent of the number of threads.
        let parts: Vec<(f64, usize)> = part.collect();
        parts.into_iter().fold((0.0, 0), |(sum, n), part| (sum + part.0, n + part.1))
    }

    fn explain_part(
        &self,
        points: &[SurfacePoint],
        owners: &[u32],
        q: &mut [f64],
        shifts: &mut [f32],
    ) {
        let (mut last, mut seed, mut plane) = (NONE, [0.0; 3], None);
        for (((point, &owner), q), shift) in points.iter().zip(owners).zip(q).zip(shifts) {
            if owner == NONE {
                (*q, *shift) = (f64::NAN, 0.0);
                continue;
            }
            // Neighbours often have the same owner.
            if owner != last {
                seed = self.seed_positions.of(owner as usize);
                (last, plane) = (owner, self.plane(owner as usize, seed));
            }
            *q = squared_distance(point.position, seed).into();
            *shift = plane.as_ref().map_or(0.0, |plane| {
                let reach = self.spacing.reach_along_ray(point);
                plane.shift(point, self.tolerance.refinement.max(reach).into()) as f32
            });
        }
    }

    fn plane(&self, id: usize, seed: [f32; 3]) -> Option<RefinementPlane> {
        // Components born in this frame have no row yet.
        let is_refined = self.refines && id < self.component_sums.len();
        is_refined.then(|| RefinementPlane::new(self.component_sums, id, seed, self.h)).flatten()
    }
}
