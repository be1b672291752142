//! Comparison of a frame's points with the scene before they are summed: distance from the seed, and
//! most probable position along the ray.
//!
//! Both are computed in one pass, whose speed is limited as much by memory as by arithmetic.

use super::component_sums::{ComponentSums, KNOWN_POINTS};
use super::components::Seeds;
use super::grid::NONE;
use super::seed_groups::Reach;
use crate::observation::surface::{DepthTolerance, SurfacePoint};
use crate::train::estep::squared_distance;
use rayon::prelude::*;

const CHUNK: usize = 1024;

pub struct Explainer<'a> {
    /// Sums of components that existed before the frame.
    pub component_sums: &'a ComponentSums,
    pub seeds: &'a Seeds,
    pub h: f64,
    pub reach: Reach,
    pub tolerance: DepthTolerance,
    pub refines: bool,
}

impl Explainer<'_> {
    /// Replaces `q` by the squared distance of each point from its component's seed (world units², NaN
    /// if the point has no component). Replaces `shifts` by the movement of each point along its ray
    /// (world units). Returns the sum of the squared distances and the number of points with a
    /// component.
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
                // NaN leaves the point out of the mean ELBO.
                (*q, *shift) = (f64::NAN, 0.0);
                continue;
            }
            // Neighbours often have the same owner.
            if owner != last {
                seed = self.seeds.of(owner as usize);
                (last, plane) = (owner, self.plane(owner as usize, seed));
            }
            *q = squared_distance(point.position, seed).into();
            *shift = plane.as_ref().map_or(0.0, |plane| {
                let reach = self.reach.along_ray(point);
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

/// Maximum weight of a component's plane relative to the measured position of a point.
const MAX_TRUST: f64 = 2.0;
/// Minimum cosine between a ray and the plane's normal for which the point is moved.
const MIN_COSINE: f64 = 0.3;

/// Plane through the points of a component, towards which new points of the component are moved.
pub struct RefinementPlane {
    seed: [f32; 3],
    /// Mean of the component's points relative to the seed, world units.
    offset: [f64; 3],
    /// Sum of the points' normals, not normalised. Its length has no effect on the shift.
    normal: [f64; 3],
    length: f64,
    /// Weight of the plane relative to the measured position of a point.
    trust: f64,
}

impl RefinementPlane {
    /// Creates the plane of a component; `None` if the component has few points. `h` is the structural
    /// scale, world units.
    #[inline(always)]
    pub fn new(component_sums: &ComponentSums, id: usize, seed: [f32; 3], h: f64) -> Option<Self> {
        let (n, first, normal) = component_sums.plane_sums(id);
        if n < KNOWN_POINTS {
            return None;
        }
        let offset = first.map(|sum| sum * h / n);
        // A limit of 2 instead of 4 gains 0.035 dB on Lego.
        let trust = (n / KNOWN_POINTS).min(MAX_TRUST);
        Some(Self { seed, offset, normal, length: dot(normal, normal).sqrt(), trust })
    }

    /// Returns the shift of a point along its ray towards the plane, world units. The shift is 0 if the
    /// plane is farther than `limit` along the ray or seen too obliquely.
    #[inline(always)]
    pub fn shift(&self, point: &SurfacePoint, limit: f64) -> f64 {
        let Self { seed, offset, normal, length, trust } = self;
        let slope = dot(*normal, point.direction.map(f64::from));
        // On a slanted ray a small error of the plane shifts the point a long way.
        if -slope < MIN_COSINE * length {
            return 0.0;
        }
        let along = |i: usize| f64::from(seed[i]) - f64::from(point.position[i]) + offset[i];
        let distance = dot(*normal, [along(0), along(1), along(2)]) / slope;
        if distance.abs() > limit {
            return 0.0;
        }
        distance * trust / (1.0 + trust)
    }
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::scene::state::VisibilityCounts;
    use crate::model::scene::sums::N_SUMS;
    use glam::DVec3;

    const H: f64 = 0.2;
    const SEED: DVec3 = DVec3::new(0.5, -0.25, 3.0);

    /// A component of `n` points whose plane faces −`ahead` and passes half a scale above the seed.
    fn plane(n: f64, ahead: DVec3) -> Option<RefinementPlane> {
        let mut row = [0.0; N_SUMS];
        (row[0], row[3]) = (n, 0.5 * n);
        (row[4], row[7], row[9]) = (n, n, n);
        row[22..25].copy_from_slice(&(ahead * -n).to_array());
        let mut sums = ComponentSums::default();
        sums.push(&row, VisibilityCounts::default());
        RefinementPlane::new(&sums, 0, SEED.as_vec3().to_array(), H)
    }

    #[test]
    fn points_move_towards_the_plane_of_their_component() {
        let ahead = DVec3::new(-2.0, 3.0, 6.0) / 7.0;
        // The point lies beside the seed and `distance` before the plane.
        let shift = |n: f64, distance: f64, direction: DVec3| {
            let beside = DVec3::new(0.03, 0.02, 0.0);
            let position = SEED + DVec3::Z * 0.5 * H + beside - direction * distance;
            let [position, direction] = [position, direction].map(|v| v.as_vec3().to_array());
            let point = SurfacePoint { position, direction, ..SurfacePoint::default() };
            plane(n, ahead).map(|plane| plane.shift(&point, 0.31))
        };
        for (n, distance, direction, expected) in [
            // The plane is trusted half at 20 points, and two thirds from 40 on.
            (20.0, 0.2, ahead, 0.1),
            (30.0, 0.2, ahead, 0.12),
            (40.0, 0.3, ahead, 0.2),
            (100.0, -0.3, ahead, -0.2),
            (20.0, 0.2, DVec3::Z, 0.1),
            (20.0, 0.2, DVec3::new(-0.28, 0.96, 0.0), 0.1),
            // Beyond the limit, on a slanted ray and from behind.
            (20.0, 0.32, ahead, 0.0),
            (20.0, -0.32, ahead, 0.0),
            (20.0, 0.2, DVec3::new(0.8, 0.6, 0.0), 0.0),
            (20.0, 0.2, -ahead, 0.0),
        ] {
            let found = shift(n, distance, direction).unwrap();
            assert!((found - expected).abs() < 2e-6, "{n} {distance} {direction}: {found}");
        }
        assert_eq!(shift(19.0, 0.2, ahead), None);
    }
}
