//! Thickness residuals: distances of points from their components' planes, with derivatives by depth
//! calibration.
//!
//! A point moves along its ray by `offset + scale · measured`, so the spread of a component's points along
//! its normal is quadratic in both. Poses are as recorded: depth must agree with them, and views with free
//! poses would hardly determine a scale.

use super::matches::{MatchedPoint, Matches};
use super::normal_equations::NormalEquations;
use super::unknowns::{DEPTH, Estimate, WITH_POSE};
use glam::DVec3;

/// Minimum length of a component's mean normal; below, it has no common plane.
const MIN_COHERENCE: f64 = 0.9;

/// Distance of a point from its component's plane, with derivatives by depth offset and scale.
#[derive(Clone, Copy)]
pub(super) struct PlaneResidual {
    pub view: usize,
    /// Along the normal, world units.
    pub off: f64,
    slope: [f64; 2],
    /// Inverse variance of the measurement noise.
    pub precision: f64,
}

/// Computes the plane residuals of a component under the depth unknowns; none at edges and corners, which
/// have no common plane. `weight` gives a point's weight by its index in the run.
pub(super) fn plane_residuals(
    matches: &Matches,
    run: &[MatchedPoint],
    at: &Estimate,
    weight: impl Fn(usize) -> f64,
    out: &mut Vec<PlaneResidual>,
) {
    out.clear();
    let n = run.len() as f64;
    let normal: DVec3 = run.iter().map(|s| s.point.normal_vector()).sum();
    if normal.length() < MIN_COHERENCE * n {
        return;
    }
    let normal = normal.normalize();
    let centre = run.iter().map(|s| s.point.position_vector()).sum::<DVec3>() / n;
    let depth = &matches.depth;
    let moved: [f64; 2] = std::array::from_fn(|i| at.unknowns.depth[i] - depth.values[i]);
    out.extend(run.iter().map(|s| {
        let pose = &matches.poses[s.view as usize];
        let direction = s.point.direction_vector();
        let per_z = if depth.along_z { 1.0 / (pose.rotation * direction).z } else { 1.0 };
        let by_offset = normal.dot(direction) * per_z;
        // Uses the plane's range: the noise in the point's own range would bias the scale downwards.
        let by_range = normal.dot(centre - pose.centre);
        let [offset, scale] = depth.values;
        let slope = [by_offset, (by_range - offset * by_offset) / scale];
        let off = normal.dot(s.point.position_vector() - centre);
        PlaneResidual {
            view: s.view as usize,
            off: off + slope[0] * moved[0] + slope[1] * moved[1],
            slope,
            // Noise grows with range, so far points weigh less.
            precision: f64::from(s.point.noise).powi(-2),
        }
    }));
    centre_on_mean(out, weight);
}

/// Centres residuals and derivatives on their weighted means: a displaced component is as thin.
fn centre_on_mean(points: &mut [PlaneResidual], weight: impl Fn(usize) -> f64) {
    let (mut sum, mut mean) = (0.0, [0.0; 3]);
    for (i, point) in points.iter().enumerate() {
        let [a, b] = point.slope;
        sum += weight(i);
        mean.iter_mut().zip([point.off, a, b]).for_each(|(m, v)| *m += weight(i) * v);
    }
    let [off, a, b] = mean.map(|m| m / sum);
    for point in points {
        point.off -= off;
        point.slope = [point.slope[0] - a, point.slope[1] - b];
    }
}

impl PlaneResidual {
    pub fn add(&self, weight: f64, equations: &mut NormalEquations<WITH_POSE>) {
        const { assert!(DEPTH[0] == 0 && DEPTH[1] == 1, "the depth unknowns come first") };
        equations.n += weight;
        equations.add_residual(self.off, &self.slope, weight * self.precision);
    }
}
