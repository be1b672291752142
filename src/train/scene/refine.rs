//! Depth refinement: most probable position of a point along its ray, given its component's plane
//! (`scene.md`, Depth refinement).

use super::component_sums::ComponentSums;
use super::sum_scalar::SumScalar;
use crate::observation::surface::SurfacePoint;

/// Minimum number of points of a component that serves as a plane.
const MIN_POINTS: f64 = 20.0;
/// Maximum weight of the plane relative to the point.
const MAX_TRUST: f64 = 2.0;
/// Minimum cosine between ray and plane normal.
const MIN_COSINE: f64 = 0.3;

/// Plane of a component, towards which its points move.
pub struct RefinementPlane {
    seed: [f32; 3],
    /// Mean of its points relative to the seed, world units.
    offset: [f64; 3],
    /// Sum of the normals, not normalised: the length cancels in the division by the slope.
    normal: [f64; 3],
    length: f64,
    /// Weight of the plane relative to a point.
    trust: f64,
}

impl RefinementPlane {
    /// Creates the plane of a component; `h` is the structural scale, world units. `None` with few points.
    #[inline(always)]
    pub fn new<W: SumScalar>(
        component_sums: &ComponentSums<W>,
        id: usize,
        seed: [f32; 3],
        h: f64,
    ) -> Option<Self> {
        let (n, first, normal) = component_sums.plane_sums(id);
        if n < MIN_POINTS {
            return None;
        }
        let offset = first.map(|sum| sum * h / n);
        // A limit of 2 instead of 4 gains 0.035 dB on Lego.
        let trust = (n / MIN_POINTS).min(MAX_TRUST);
        Some(Self { seed, offset, normal, length: dot(normal, normal).sqrt(), trust })
    }

    /// Returns the shift of a point along its ray, world units. `limit` is the maximum distance to the plane
    /// at which the point belongs to the same surface.
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
