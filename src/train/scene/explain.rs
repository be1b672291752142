//! What the scene says of a frame's points before they are summed: how far each is from its seed, and where
//! along its ray it most probably lies.
//!
//! Both at once: a pass over the points of a frame takes as long for their memory as for its arithmetic.

use super::component_sums::ComponentSums;
use super::grid::{NONE, squared_distance};
use super::refine::RefinementPlane;
use super::seed_positions::SeedPositions;
use super::spacing::Spacing;
use super::sum_scalar::SumScalar;
use crate::observation::surface::{DepthTolerance, SurfacePoint};
use rayon::prelude::*;

/// Points of a task.
const CHUNK: usize = 1024;

/// The scene as a frame's points are seen in it.
pub struct Explainer<'a, W> {
    /// Sums of the components that the frame did not bring about.
    pub component_sums: &'a ComponentSums<W>,
    /// Where all components stand.
    pub seed_positions: SeedPositions<'a>,
    /// Structural scale, world units.
    pub h: f64,
    pub spacing: Spacing,
    pub tolerance: DepthTolerance,
    /// Whether depths are refined.
    pub refines: bool,
}

impl<W: SumScalar> Explainer<'_, W> {
    /// Replaces `q` by the squared distances of points from the seeds of their owners, NaN without one, and
    /// `shifts` by how far they move along their rays, both in world units. Gives the sum of the distances and
    /// the number of points that have an owner.
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
        // Added in the order of the parts, which have one size: it rounds alike on any number of threads.
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
            // Neighbours often have one owner.
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
