//! Residuals of matched views as evidence about all unknowns: surfaces must be thin and have equal colours
//! in all views.
//!
//! Residuals get Cauchy weights, recomputed before every fit, because silhouettes, mirrors and moving
//! objects must not affect the calibration. Colour and thickness residuals are scaled by their
//! information so that they can be summed with each other and with the sensor prior. For colour, all
//! points of a component in one view count as one observation with the residuals' variance. Each view's
//! pose is also fitted within its prior, so that pose errors do not bias the camera. For thickness, the
//! weight is divided by the overdispersion of the views' gradients relative to independent points.

use super::camera::Projector;
use super::color;
use super::color::{ColorResidual, Photos, color_residuals};
use super::covariance::overdispersion;
use super::gains::fit_gains;
use super::matches::{MatchedPoint, Matches};
use super::pyramid::Pyramid;
use super::unknowns::{DEPTH, Estimate, SensorPrior, Twist, Unknowns, WITH_POSE};
use crate::math::least_squares::NormalEquations;
use glam::DVec3;
use rayon::prelude::*;

/// Number of components per partial sum. A fixed number makes the sums independent of the number of
/// threads.
const CHUNK: usize = 1024;
/// Stride of the components whose residuals are used to estimate the median.
const MEDIAN_SAMPLE_STRIDE: usize = 5;
/// Residual, in multiples of the median residual, at which a point has weight ½.
const OUTLYING: f64 = 4.0;
/// Minimum variance of thickness and colour residuals: a tenth of the sensor noise, and one 8-bit step
/// in each of three channels. Rendered images may have no noise at all.
const LEAST_VARIANCE: [f64; 2] = [0.01, 3.0 / (255.0 * 255.0)];

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ResidualKind {
    Thickness,
    Color,
}

type Both = [NormalEquations<WITH_POSE>; 2];
const NOTHING: Both = [NormalEquations::ZERO; 2];

pub(super) struct Evidence<'a> {
    pub matches: Matches,
    images: &'a [Pyramid],
    level: usize,
    pub gains: Vec<[f64; 3]>,
    /// Weight of each point for each kind of residual; 1 before the first update.
    weights: [Vec<f32>; 2],
    /// Information (inverse variance) of a squared residual, for each kind of residual.
    information: [f64; 2],
    /// Sum of weights at the last update, for each kind of residual. Later sums differ, because points
    /// leave the images as cameras move.
    points: [f64; 2],
    /// Squared residual at which a point has weight ½, for each kind of residual.
    pub(super) half_weight_squares: [f64; 2],
    /// Squared difference between the estimates from two halves of the views, relative to the variance
    /// that their equations predict; 1 before the comparison.
    overdispersion: f64,
}

#[derive(Default)]
struct Buffers {
    planes: Vec<PlaneResidual>,
    colors: Vec<ColorResidual>,
}

impl<'a> Evidence<'a> {
    /// Creates evidence with uniform weights. `images` and `gains` have one entry per view of the
    /// matches.
    pub fn new(
        matches: Matches,
        images: &'a [Pyramid],
        gains: Vec<[f64; 3]>,
        level: usize,
    ) -> Self {
        let weights = [(); 2].map(|()| vec![1.0; matches.samples().len()]);
        let [information, points, knees] = [[1.0; 2]; 3];
        Self {
            matches,
            images,
            level,
            gains,
            weights,
            information,
            points,
            half_weight_squares: knees,
            overdispersion: 1.0,
        }
    }

    pub fn update_weights(&mut self, at: &Estimate) {
        self.weights.iter_mut().for_each(|weights| weights.fill(1.0));
        let squares = self.squared_residuals(at);
        // The median of perfect data is zero.
        self.half_weight_squares = squares.each_ref().map(|squares| {
            (OUTLYING * OUTLYING * self.sampled_median(squares)).max(f64::MIN_POSITIVE)
        });
        for ((weights, squares), knee) in
            self.weights.iter_mut().zip(squares).zip(self.half_weight_squares)
        {
            let weigh = |(weight, square): (&mut f32, Option<f64>)| {
                // A point without a residual is outside an image, or its component has no plane.
                *weight = square.map_or(1.0, |square| 1.0 / (1.0 + square / knee)) as f32;
            };
            weights.iter_mut().zip(squares).for_each(weigh);
        }
        let views = self.equations_by_view(at);
        let [thickness, colors] =
            [0, 1].map(|k| views.iter().map(|both| both[k]).collect::<Vec<_>>());
        let [planes, seen] = [&thickness, &colors].map(NormalEquations::total);
        self.points = [planes.n, seen.n];
        // All points of a component in one view count as one observation.
        let witnesses = self.matches.n_sightings() as f64 / self.matches.samples().len() as f64;
        self.information = [
            1.0 / overdispersion(&thickness).max(LEAST_VARIANCE[0]),
            witnesses / seen.variance().max(LEAST_VARIANCE[1]),
        ]
        .map(|information| information / self.overdispersion);
    }

    /// Returns the change between two estimates: the larger of the image shift and the depth change. The
    /// image shift is in pixels of the pyramid level. The depth change is relative to
    /// [`Self::quantisation_floor`].
    pub fn change_in_pixels(&self, from: &Unknowns, to: &Unknowns) -> f64 {
        let shift =
            color::rms_pixel_distance(&self.matches, from, to) / f64::from(1u32 << self.level);
        let [offset, scale] = self.quantisation_floor();
        let [nearer, larger] = [0, 1].map(|i| (to.depth[i] - from.depth[i]).abs());
        shift.max(nearer / offset).max(larger / scale)
    }

    pub fn update_gains(&mut self, at: &Estimate) {
        let patches = color::patches(&self.matches, &self.photos(), at);
        self.gains = fit_gains(&patches, self.images.len());
    }

    fn photos(&self) -> Photos<'_> {
        Photos { images: self.images, gains: &self.gains, level: self.level }
    }

    /// Adds up the residuals of the components of each chunk, in order. Returns one result per chunk.
    fn collect_residuals<T: Send>(
        &self,
        at: &Estimate,
        start: impl Fn() -> T + Sync,
        add: impl Fn(&mut T, usize, &Buffers) + Sync,
    ) -> Vec<T> {
        let projector = Projector::new(&at.unknowns.camera);
        let components = (0..self.matches.len()).into_par_iter().chunks(CHUNK);
        let of_chunk = |components: Vec<usize>| {
            let (mut found, mut buffers) = (start(), Buffers::default());
            for component in components {
                self.compute_residuals((&projector, at), component, &mut buffers);
                add(&mut found, component, &buffers);
            }
            found
        };
        components.map(of_chunk).collect()
    }

    /// Computes both kinds of residuals of a component's points into `buffers`.
    fn compute_residuals(
        &self,
        at: (&Projector, &Estimate),
        component: usize,
        buffers: &mut Buffers,
    ) {
        let first = self.matches.start_of(component);
        let run = self.matches.points_of(component);
        let weight = |k: usize| move |i: usize| f64::from(self.weights[k][first + i]);
        // Weights enter here already: residuals are relative to a weighted mean.
        plane_residuals(&self.matches, run, at.1, weight(0), &mut buffers.planes);
        color_residuals(&self.matches, &self.photos(), run, at, &mut buffers.colors);
    }

    fn sampled_median(&self, squares: &[Option<f64>]) -> f64 {
        let sampled = (0..self.matches.len()).step_by(MEDIAN_SAMPLE_STRIDE).flat_map(|component| {
            let first = self.matches.start_of(component);
            &squares[first..first + self.matches.points_of(component).len()]
        });
        let mut sampled: Vec<f64> = sampled.flatten().copied().collect();
        if sampled.is_empty() {
            return 0.0;
        }
        let middle = sampled.len() / 2;
        *sampled.select_nth_unstable_by(middle, f64::total_cmp).1
    }

    pub(super) fn squared_residuals(&self, at: &Estimate) -> [Vec<Option<f64>>; 2] {
        let start = || [Vec::new(), Vec::new()];
        let parts = self.collect_residuals(at, start, |found, component, buffers| {
            let first = found[0].len();
            let end = first + self.matches.points_of(component).len();
            found.iter_mut().for_each(|squares| squares.resize(end, None));
            for (i, plane) in buffers.planes.iter().enumerate() {
                found[0][first + i] = Some(plane.off * plane.off * plane.precision);
            }
            for color in &buffers.colors {
                found[1][first + color.index] = Some(color.square());
            }
        });
        let mut whole = [Vec::new(), Vec::new()];
        for part in parts {
            whole.iter_mut().zip(part).for_each(|(whole, part)| whole.extend(part));
        }
        whole
    }

    /// Returns the normal equations of each view for each kind of residual. Thickness residuals are
    /// relative to the mean of their component over all views.
    pub fn equations_by_view(&self, at: &Estimate) -> Vec<Both> {
        let n = self.matches.poses.len();
        let start = || vec![NOTHING; n];
        let parts = self.collect_residuals(at, start, |views, component, buffers| {
            let first = self.matches.start_of(component);
            for (i, plane) in buffers.planes.iter().enumerate() {
                let weight = f64::from(self.weights[0][first + i]);
                plane.add(weight, &mut views[plane.view][0]);
            }
            for color in &buffers.colors {
                let weight = f64::from(self.weights[1][first + color.index]);
                color.add(weight, &mut views[color.view][1]);
            }
        });
        let mut views = vec![NOTHING; n];
        for part in &parts {
            for (view, part) in views.iter_mut().zip(part) {
                view.iter_mut().zip(part).for_each(|(view, part)| view.add(part, 1.0));
            }
        }
        views
    }

    pub fn variance(&self, at: &Estimate, kind: ResidualKind) -> f64 {
        let views = self.equations_by_view(at);
        NormalEquations::total(views.iter().map(|both| &both[kind as usize])).variance()
    }

    /// Returns, for each view, the weighted sum of the pose prior and the equations of both kinds of
    /// residuals.
    pub(super) fn weighted_equations(
        &self,
        prior: &SensorPrior,
        at: &Estimate,
    ) -> Vec<NormalEquations<WITH_POSE>> {
        let views = self.equations_by_view(at);
        // Normalised by the number of points: otherwise a camera would gain by losing points.
        let factors = [0, 1].map(|k| {
            let n: f64 = views.iter().map(|both| both[k].n).sum();
            self.information[k] * self.points[k] / n.max(f64::MIN_POSITIVE)
        });
        let of_view = |(both, pose): (&Both, &Twist)| {
            let mut sum = NormalEquations::ZERO;
            both.iter().zip(factors).for_each(|(of_kind, factor)| sum.add(of_kind, factor));
            prior.add_pose(pose, &mut sum);
            sum
        };
        views.iter().zip(&at.poses).map(of_view).collect()
    }

    pub fn scale_down(&mut self, times: f64) {
        self.overdispersion *= times;
        self.information = self.information.map(|information| information / times);
    }

    /// Returns the smallest changes of depth offset and depth scale that the views can reveal.
    /// Quantisation hides smaller changes, because its error is the same for all points of a surface.
    pub(super) fn quantisation_floor(&self) -> [f64; 2] {
        let samples = self.matches.samples();
        let n = samples.len().max(1) as f64;
        let noise = samples.iter().map(|s| f64::from(s.point.noise)).sum::<f64>() / n;
        let range = samples.iter().map(|s| f64::from(s.point.range)).sum::<f64>() / n;
        [0.25 * noise, 0.25 * noise / range]
    }
}

// Unit normals of a plane add up to nearly their number.
const MIN_COHERENCE: f64 = 0.9;

/// Distance of a point from its component's plane, and its derivatives with respect to depth offset and
/// depth scale.
#[derive(Clone, Copy)]
pub(super) struct PlaneResidual {
    pub view: usize,
    /// Signed distance along the plane's normal, world units.
    pub off: f64,
    slope: [f64; 2],
    /// Inverse variance of the measurement noise.
    pub precision: f64,
}

/// Computes the distances of a component's points from their common plane under the current depth
/// unknowns. Edges and corners have no common plane and yield no residuals. `weight` returns a point's
/// weight by its index in `run`.
pub(super) fn plane_residuals(
    matches: &Matches,
    run: &[MatchedPoint],
    at: &Estimate,
    weight: impl Fn(usize) -> f64,
    out: &mut Vec<PlaneResidual>,
) {
    // Reused for all components, to avoid an allocation for each.
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

/// Subtracts the weighted means from residuals and derivatives. A shift of the whole component does not
/// make it thicker.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::calibrate::test_views::{begin, ramps, wall};
    use crate::calibrate::unknowns::N;

    #[test]
    fn gradients_are_those_of_finite_differences() {
        let images = ramps(2);
        let gains = vec![[1.0; 3], [1.1, 0.9, 1.0]];
        let evidence = Evidence::new(wall(0.3), &images, gains, 0);
        // Away from the values under which points were matched.
        let mut at = Estimate::as_recorded(begin(), 2);
        at.unknowns.depth = [0.004, 1.003];
        at.poses[1] = [0.003, -0.002, 0.001, 0.002, 0.001, -0.003];
        let views = evidence.equations_by_view(&at);
        for k in 0..2 {
            let total = NormalEquations::total(views.iter().map(|both| &both[k]));
            assert!(total.cost > 0.1 && total.n == 512.0, "{k}: {} {}", total.cost, total.n);
            for i in 0..WITH_POSE {
                let step = 1e-5;
                let cost = |sign: f64| {
                    let mut moved = at.clone();
                    match i.checked_sub(N) {
                        Some(i) => moved.poses[1][i] += sign * step,
                        None => moved.unknowns.set(i, moved.unknowns.get(i) + sign * step),
                    }
                    let views = evidence.equations_by_view(&moved);
                    // A pose is fitted only to the residuals of its own view.
                    match i < N {
                        true => NormalEquations::total(views.iter().map(|both| &both[k])).cost,
                        false => views[1][k].cost,
                    }
                };
                let expected = (cost(1.0) - cost(-1.0)) / (4.0 * step);
                let found = if i < N { total.gradient[i] } else { views[1][k].gradient[i] };
                let error = (found - expected).abs();
                assert!(error < 1e-3 * expected.abs().max(1.0), "{k} {i}: {found} {expected}");
            }
        }
    }
}
