//! How far points lie off the planes of their components, and how that changes with depth's calibration.
//!
//! A point moves along its ray by `offset + scale · measured`, so that the spread of a component's points
//! along its normal is a quadratic form in both. Poses are as recorded: depth is wanted that agrees with
//! them, and views whose poses may give way tell little of a scale.

use super::matches::{MatchedPoint, Matches};
use super::normal_equations::NormalEquations;
use super::unknowns::{DEPTH, Estimate, WITH_POSE};
use glam::DVec3;

/// Least length of the mean of a component's normals: less is no plane.
const MIN_COHERENCE: f64 = 0.9;

/// A point's distance from the plane of its component's points, and how it changes with offset and scale.
#[derive(Clone, Copy)]
pub(super) struct PlaneOffset {
    pub view: usize,
    /// World units, along the normal.
    pub off: f64,
    slope: [f64; 2],
    /// Of the measurement's noise: inverse variance.
    pub precision: f64,
}

/// Adds the points of a component as depth's unknowns put them; nothing around an edge or a corner, which
/// has no one plane to be thin about. `weight` is that of a point by its place in the run.
pub(super) fn plane_offsets(
    matches: &Matches,
    run: &[MatchedPoint],
    at: &Estimate,
    weight: impl Fn(usize) -> f64,
    out: &mut Vec<PlaneOffset>,
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
        // By what the plane's range would: the point's own holds noise that would pull the scale down.
        let by_range = normal.dot(centre - pose.centre);
        let [offset, scale] = depth.values;
        let slope = [by_offset, (by_range - offset * by_offset) / scale];
        let off = normal.dot(s.point.position_vector() - centre);
        PlaneOffset {
            view: s.view as usize,
            off: off + slope[0] * moved[0] + slope[1] * moved[1],
            slope,
            // A far point tells little of an offset of millimetres.
            precision: f64::from(s.point.noise).powi(-2),
        }
    }));
    about_their_mean(out, weight);
}

/// A component that lies off its place as a whole is as thin.
fn about_their_mean(points: &mut [PlaneOffset], weight: impl Fn(usize) -> f64) {
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

impl PlaneOffset {
    /// Adds it to its view's equations.
    pub fn add(&self, weight: f64, equations: &mut NormalEquations<WITH_POSE>) {
        const { assert!(DEPTH[0] == 0 && DEPTH[1] == 1, "depth's unknowns are the first of all") };
        equations.n += weight;
        equations.add_residual(self.off, &self.slope, weight * self.precision);
    }
}
