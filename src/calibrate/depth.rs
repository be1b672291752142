//! Depth bias and scale: surfaces that several views see are thinnest where both are right.
//!
//! A point moves along its ray by `bias + scale · range`, so that the spread of a component's
//! points along its normal is a quadratic form in both, whose minimum is a linear system.
//!
//! Standard errors are by jackknife over the views, not over points: points of a view share the
//! error of its pose. Errors common to all views stay unseen.

use super::matches::{MatchedPoint, Matches};
use super::normal_equations::NormalEquations;
use crate::math::cholesky::Cholesky;
use glam::DVec3;
use rayon::prelude::*;

/// Components of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 1024;
/// Least length of the mean of a component's normals: less is no plane.
const MIN_COHERENCE: f64 = 0.9;

/// Normal equations of how thick surfaces are by a depth offset and a relative change of scale.
type ThicknessEquations = NormalEquations<2>;

/// What thin surfaces say of depth.
pub(super) struct DepthFit {
    views: Vec<ThicknessEquations>,
    /// Quarter of the mean noise half-width: within it quantisation hides any bias.
    floor: f64,
    /// Mean length of a ray.
    range: f64,
}

impl DepthFit {
    /// `along_z`: whether the files measure along the optical axis.
    pub fn new(matches: &Matches, along_z: bool) -> Self {
        let n = matches.poses.len();
        let parts: Vec<Vec<ThicknessEquations>> = (0..matches.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|components| {
                let mut views = vec![NormalEquations::ZERO; n];
                components
                    .into_iter()
                    .for_each(|i| add_component(matches, matches.of(i), along_z, &mut views));
                views
            })
            .collect();
        let mut views = vec![NormalEquations::ZERO; n];
        for part in &parts {
            views.iter_mut().zip(part).for_each(|(view, part)| view.add(part, 1.0));
        }
        let samples = matches.samples();
        let mean = |of: fn(&MatchedPoint) -> f32| {
            samples.iter().map(|s| f64::from(of(s))).sum::<f64>() / samples.len() as f64
        };
        Self { views, floor: 0.25 * mean(|s| s.point.noise), range: mean(|s| s.point.range) }
    }

    /// Offset and relative change of scale that thin surfaces most; the others than the `free` are 0.
    pub fn change(&self, free: &[usize]) -> [f64; 2] {
        minimum(&self.total(), free)
    }

    fn total(&self) -> ThicknessEquations {
        NormalEquations::total(&self.views)
    }

    /// Standard errors of both: by jackknife over the views, and at least what quantisation hides.
    pub fn errors(&self, free: &[usize]) -> [f64; 2] {
        let total = self.total();
        let change = minimum(&total, free);
        let n = self.views.len() as f64;
        let mut variance = [0.0; 2];
        for view in &self.views {
            let mut rest = total;
            rest.add(view, -1.0);
            let without = minimum(&rest, free);
            for i in 0..2 {
                variance[i] += (without[i] - change[i]).powi(2) * (n - 1.0) / n;
            }
        }
        // Quantisation shifts all points of a surface alike, which no view contradicts.
        let floors = [self.floor, self.floor / self.range];
        std::array::from_fn(|i| f64::hypot(variance[i].sqrt(), floors[i]))
    }

    /// By how much the square of the thickness would rise, relatively, if a value at the minimum
    /// moved by `change` and the other `free` ones followed: `change² / (C⁻¹)ᵥᵥ`.
    pub fn rise(&self, value: usize, change: f64, free: &[usize]) -> f64 {
        let total = self.total();
        let unit: Vec<f64> = free.iter().map(|&i| f64::from(u8::from(i == value))).collect();
        let factor = Cholesky::new(free.len(), &total.curvature_of(free));
        factor.map_or(0.0, |factor| {
            let along: f64 = factor.solve(&unit).iter().zip(&unit).map(|(x, u)| x * u).sum();
            change * change / along / total.cost
        })
    }
}

/// The offset and the relative change of scale at the minimum, of which only the `free` may differ
/// from 0.
fn minimum(equations: &ThicknessEquations, free: &[usize]) -> [f64; 2] {
    let mut change = [0.0; 2];
    if let Some(step) = equations.step(free, 0.0) {
        free.iter().zip(step).for_each(|(&i, x)| change[i] = x);
    }
    change
}

fn add_component(
    matches: &Matches,
    run: &[MatchedPoint],
    along_z: bool,
    views: &mut [ThicknessEquations],
) {
    let n = run.len() as f64;
    let normal: DVec3 = run.iter().map(|s| s.point.normal_vector()).sum();
    // A component around an edge or a corner has no one plane to be thin about.
    if normal.length() < MIN_COHERENCE * n {
        return;
    }
    let normal = normal.normalize();
    let centre = run.iter().map(|s| s.point.position_vector()).sum::<DVec3>() / n;
    // How far the point lies off the plane, and how that changes with offset and scale. The point
    // moves by what the plane's range would: its own holds noise that would pull the scale down.
    let row = |s: &MatchedPoint| {
        let pose = &matches.poses[s.view as usize];
        let direction = s.point.direction_vector();
        let per_z = if along_z { 1.0 / (pose.rotation * direction).z } else { 1.0 };
        [
            normal.dot(s.point.position_vector() - centre),
            normal.dot(direction) * per_z,
            normal.dot(centre - pose.centre),
        ]
    };
    let mut mean = [0.0; 3];
    for sample in run {
        mean.iter_mut().zip(row(sample)).for_each(|(mean, value)| *mean += value / n);
    }
    for sample in run {
        let value = row(sample);
        // About the mean: a component that lies off its place as a whole is as thin.
        let [off, slope @ ..]: [f64; 3] = std::array::from_fn(|i| value[i] - mean[i]);
        // By inverse variance: a far point tells little of an offset of millimetres.
        let weight = f64::from(sample.point.noise).powi(-2);
        let view = &mut views[sample.view as usize];
        view.n += 1.0;
        view.add_residual(off, &slope, weight);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::matches::CameraPose;
    use crate::observation::surface::SurfacePoint;
    use glam::DMat3;

    /// A wall and a floor seen from places at several distances, as a depth camera with this error
    /// measures them.
    fn room(offset: f64, scale: f64) -> Matches {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for view in 0..6 {
            let centre = DVec3::new(0.3 * f64::from(view), -0.2, -0.25 * f64::from(view));
            let mut points = Vec::new();
            for i in 0..400 {
                let (x, y) = (0.05 * f64::from(i % 20) - 0.5, 0.05 * f64::from(i / 20) - 0.5);
                let wall = (DVec3::new(x, y, 2.0), DVec3::NEG_Z);
                let floor = (DVec3::new(x, 0.8, y + 1.0), DVec3::NEG_Y);
                for (place, normal) in [wall, floor] {
                    let true_range = (place - centre).length();
                    let direction = (place - centre) / true_range;
                    // What a correction by `offset` and `scale` makes right.
                    let range = (true_range - offset) / scale;
                    points.push(SurfacePoint {
                        position: (centre + range * direction).as_vec3().to_array(),
                        range: range as f32,
                        noise: 0.002,
                        normal: normal.as_vec3().to_array(),
                        direction: direction.as_vec3().to_array(),
                        ..SurfacePoint::default()
                    });
                }
            }
            views.push(points);
            poses.push(CameraPose { rotation: DMat3::IDENTITY, centre });
        }
        Matches::together(&views, poses, 0.25)
    }

    #[test]
    fn offset_and_scale_are_found() {
        let fit = DepthFit::new(&room(0.01, 1.004), false);
        let [offset, growth] = fit.change(&[0, 1]);
        assert!((offset - 0.01).abs() < 1e-3 && (growth - 0.004).abs() < 6e-4, "{offset} {growth}");
        let fit = DepthFit::new(&room(0.01, 1.0), false);
        let [offset, growth] = fit.change(&[0]);
        assert!((offset - 0.01).abs() < 3e-4 && growth == 0.0, "{offset}");
        assert!(fit.rise(0, offset, &[0]) > 0.9, "all the thickness there is comes of it");
        assert!(fit.errors(&[0])[0] >= 0.0005, "a quarter of the noise is hidden");
    }

    #[test]
    fn true_depth_stays() {
        let fit = DepthFit::new(&room(0.0, 1.0), false);
        let [offset, growth] = fit.change(&[0, 1]);
        assert!(offset.abs() < 1e-5 && growth.abs() < 1e-5, "{offset} {growth}");
    }
}
