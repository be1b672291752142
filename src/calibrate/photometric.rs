//! Variance of colour inside components, and how it changes with the colour camera.
//!
//! A component's points are projected into the colour image of their own view; how their colours
//! differ from the component's mean is what a wrong camera causes. The mean moves with the camera
//! too, so its slope is taken off every point's slope. Sums are per view, for standard errors,
//! and in chunks of fixed size, so that the number of threads changes no bit.

use super::exposure::Patch;
use super::matches::{MatchedPoint, Matches};
use super::normal_equations::NormalEquations;
use super::pinhole::{CameraUnknowns, N, Projector};
use super::pyramid::Pyramid;
use rayon::prelude::*;

/// Components of one partial sum: sums do not depend on the number of threads.
const CHUNK: usize = 1024;

/// `Σ |c − c̄|²` over the points of components, `c̄` the mean of a component over all views.
pub(super) struct PhotometricCost<'a> {
    pub matches: &'a Matches,
    pub images: &'a [Pyramid],
    /// Factors of red, green and blue, by view.
    pub gains: &'a [[f64; 3]],
    /// Size of the images, 0 the whole.
    pub level: usize,
}

/// A point's colour as some view shows it.
struct PointColor {
    view: usize,
    color: [f64; 3],
    slope: [[f64; N]; 3],
}

impl PhotometricCost<'_> {
    /// NormalEquations equations of every view by itself, about the means over all of them.
    pub fn by_view(&self, unknowns: &CameraUnknowns) -> Vec<NormalEquations<N>> {
        let projector = Projector::new(unknowns);
        let parts: Vec<Vec<NormalEquations<N>>> = (0..self.matches.len())
            .into_par_iter()
            .chunks(CHUNK)
            .map(|components| {
                let mut views = vec![NormalEquations::ZERO; self.matches.poses.len()];
                let mut colors = Vec::new();
                for component in components {
                    let samples = self.matches.of(component);
                    colors.clear();
                    colors.extend(samples.iter().filter_map(|s| self.point(&projector, s)));
                    add_component(&colors, &mut views);
                }
                views
            })
            .collect();
        let mut views = vec![NormalEquations::ZERO; self.matches.poses.len()];
        for part in parts {
            views.iter_mut().zip(&part).for_each(|(view, part)| view.add(part, 1.0));
        }
        views
    }

    fn point(&self, projector: &Projector, sample: &MatchedPoint) -> Option<PointColor> {
        let view = sample.view as usize;
        let projected = projector.project(sample.local)?;
        let texel = self.images[view].sample(self.level, projected.at)?;
        // A gain scales slopes as it scales colours.
        let gain = self.gains[view];
        let color = std::array::from_fn(|i| gain[i] * texel.color[i]);
        let slope = std::array::from_fn(|i| {
            let [across, down] = texel.slope[i];
            std::array::from_fn(|j| {
                gain[i] * (across * projected.slope[0][j] + down * projected.slope[1][j])
            })
        });
        Some(PointColor { view, color, slope })
    }

    /// Mean colours of components by view, before gains; sorted by component.
    pub fn patches(&self, unknowns: &CameraUnknowns) -> Vec<Patch> {
        let projector = Projector::new(unknowns);
        let mut patches = Vec::new();
        for component in 0..self.matches.len() {
            for run in self.matches.of(component).chunk_by(|a, b| a.view == b.view) {
                let view = run[0].view;
                let image = &self.images[view as usize];
                let mut patch = Patch::new(component as u32, view);
                let projected = run.iter().filter_map(|s| projector.project(s.local));
                projected
                    .filter_map(|projected| image.sample(self.level, projected.at))
                    .for_each(|texel| patch.add(texel.color));
                patches.push(patch);
            }
        }
        patches
    }

    /// Root mean square of the shift in the image, pixels, that a unit of every unknown makes.
    pub fn shifts(&self, unknowns: &CameraUnknowns) -> [f64; N] {
        let projector = Projector::new(unknowns);
        let (mut sum, mut n) = ([0.0; N], 0.0);
        for projected in self.matches.samples().iter().filter_map(|s| projector.project(s.local)) {
            n += 1.0;
            for (sum, (u, v)) in
                sum.iter_mut().zip(projected.slope[0].iter().zip(&projected.slope[1]))
            {
                *sum += u * u + v * v;
            }
        }
        sum.map(|sum| (sum / n).sqrt())
    }

    /// Root mean square of the distance, pixels, between where two cameras see the points.
    pub fn distance(&self, a: &CameraUnknowns, b: &CameraUnknowns) -> f64 {
        let (a, b) = (Projector::new(a), Projector::new(b));
        let (mut sum, mut n) = (0.0, 0.0);
        for sample in self.matches.samples() {
            if let (Some(a), Some(b)) = (a.project(sample.local), b.project(sample.local)) {
                sum += (a.at[0] - b.at[0]).powi(2) + (a.at[1] - b.at[1]).powi(2);
                n += 1.0;
            }
        }
        f64::sqrt(sum / n)
    }
}

/// Adds a component's colors, which are sorted by view, unless one view alone sees it.
fn add_component(colors: &[PointColor], views: &mut [NormalEquations<N>]) {
    if colors.len() < 2 || colors[0].view == colors[colors.len() - 1].view {
        return;
    }
    // The mean moves with the unknowns as its points do.
    let (color, slope) = means(colors);
    for point in colors {
        let equations = &mut views[point.view];
        equations.n += 1.0;
        for i in 0..3 {
            let row: [f64; N] = std::array::from_fn(|j| point.slope[i][j] - slope[i][j]);
            equations.add_residual(point.color[i] - color[i], &row, 1.0);
        }
    }
}

fn means(colors: &[PointColor]) -> ([f64; 3], [[f64; N]; 3]) {
    let weight = 1.0 / colors.len() as f64;
    let (mut color, mut slope) = ([0.0; 3], [[0.0; N]; 3]);
    for point in colors {
        for i in 0..3 {
            color[i] += weight * point.color[i];
            slope[i].iter_mut().zip(point.slope[i]).for_each(|(mean, s)| *mean += weight * s);
        }
    }
    (color, slope)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::matches::CameraPose;
    use crate::dataset::calibration::ColorCamera;
    use crate::math::image::Image;
    use crate::observation::surface::SurfacePoint;
    use glam::{DMat3, DVec3};

    const CAMERA: ColorCamera = ColorCamera {
        focal: [80.0, 80.0],
        principal: [40.0, 30.0],
        offset: [0.01, -0.02, 0.0],
        rotation: [0.0, 0.0, 0.02],
        size: None,
    };

    /// A wall before two cameras side by side, photographs of which are ramps.
    fn wall() -> (Matches, Vec<Pyramid>) {
        let (mut views, mut poses) = (Vec::new(), Vec::new());
        for view in 0..2 {
            let point = |i: u32| SurfacePoint {
                position: [0.03 * (i % 16) as f32 - 0.2, 0.03 * (i / 16) as f32 - 0.2, 2.0],
                normal: [0.0, 0.0, -1.0],
                ..SurfacePoint::default()
            };
            views.push((0..256).map(point).collect());
            let centre = DVec3::new(0.1 * f64::from(view), 0.0, 0.3 * f64::from(view));
            poses.push(CameraPose { rotation: DMat3::IDENTITY, centre });
        }
        let ramp = |i: usize| [(3 * (i % 80)) as u8, (4 * (i / 80)) as u8, 100, 255];
        let image = || Image::from_vec(80, 60, (0..80 * 60).map(ramp).collect());
        let images = (0..2).map(|_| Pyramid::new(image(), 1)).collect();
        (Matches::together(&views, poses, 0.1), images)
    }

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let (matches, images) = wall();
        let gains = [[1.0; 3], [1.1, 0.9, 1.0]];
        let problem =
            PhotometricCost { matches: &matches, images: &images, gains: &gains, level: 0 };
        let unknowns = CameraUnknowns::of(CAMERA);
        let total = NormalEquations::total(&problem.by_view(&unknowns));
        assert!(total.cost > 0.5 && total.n == 512.0, "{} {}", total.cost, total.n);
        for i in 0..N {
            let step = 1e-5;
            let cost = |sign: f64| {
                let mut moved = unknowns;
                moved.values[i] += sign * step;
                NormalEquations::total(&problem.by_view(&moved)).cost
            };
            let expected = (cost(1.0) - cost(-1.0)) / (4.0 * step);
            let error = (total.gradient[i] - expected).abs();
            assert!(
                error < 1e-4 * expected.abs().max(1.0),
                "{i}: {} {expected}",
                total.gradient[i]
            );
        }
    }

    #[test]
    fn distances_are_in_pixels() {
        let (matches, images) = wall();
        let gains = [[1.0; 3]; 2];
        let problem =
            PhotometricCost { matches: &matches, images: &images, gains: &gains, level: 0 };
        let unknowns = CameraUnknowns::of(CAMERA);
        let mut moved = unknowns;
        moved.values[4] += 3.0;
        moved.values[5] -= 4.0;
        assert!((problem.distance(&unknowns, &moved) - 5.0).abs() < 1e-9);
        assert!((problem.shifts(&unknowns)[5] - 1.0).abs() < 1e-12);
    }
}
