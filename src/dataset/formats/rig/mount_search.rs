//! Estimates the mount of a camera on the tracked body.
//!
//! An error of the mount displaces two images differently if one is rotated relative to the other. The
//! maximum a posteriori mount is found by Gauss-Newton with Cauchy weights. Derivatives are finite
//! differences, because depth images are sampled per pixel. The mount is accepted if it reduces the
//! difference within image pairs that it was not fitted to.

use super::clock::Clock;
use super::{DepthPair, total_distance};
use crate::math::camera::Intrinsics;
use crate::math::least_squares::NormalEquations;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Minimum number of image pairs for an estimate.
const FEWEST: usize = 6;
/// Minimum relative decrease of the difference between images for accepting a mount. It is measured on
/// pairs that were not used for the fit.
const FALL: f64 = 0.05;
const ROUNDS: usize = 12;
/// Maximum number of tested step lengths; each is twice the previous one.
const DOUBLINGS: u32 = 5;
/// Minimum relative decrease of the difference between images in a round; with less, the fit stops.
const SETTLED: f64 = 0.002;
/// Half-widths of the finite differences, radians and metres. They shift images by about ten pixels,
/// over which depth noise averages out.
const EPS: [f64; N] = [0.016, 0.016, 0.016, 0.04, 0.04, 0.04];
/// Prior standard deviations of rotation (radians) and translation (metres).
const EXPECTED: [f64; N] = [0.03, 0.03, 0.03, 0.05, 0.05, 0.05];
/// Relative depth difference at which the Cauchy weight is one half.
const ROBUST: f64 = 0.01;
/// Number of correlated neighbouring samples that count as one sample.
const ALIKE: f64 = 20.0;

/// Number of parameters of a mount: rotation about the camera's axes and translation along them.
const N: usize = 6;
type Vector = [f64; N];

fn mount_of([a, b, c, x, y, z]: Vector) -> Mount {
    Mount { shift: DVec3::new(x, y, z), turn: DVec3::new(a, b, c) }
}

/// Estimates the mount from image pairs. Returns the identity if the mount is undetermined.
pub(super) fn find(pairs: &[DepthPair<'_>], clock: &Clock<'_>, delay: f64) -> Mount {
    if pairs.len() < FEWEST {
        return Mount::default();
    }
    let search = Search { clock, delay };
    // Alternating, so that both halves span the recording.
    let (every, other): (Vec<_>, Vec<_>) = pairs.iter().enumerate().partition(|(i, _)| i % 2 == 0);
    let [every, other] =
        [every, other].map(|half| half.into_iter().map(|(_, pair)| pair).collect());
    let serves = |found_by: &Vec<&DepthPair<'_>>, others: &Vec<&DepthPair<'_>>| {
        let least = (1.0 - FALL) * search.distance(others, Mount::default());
        search.distance(others, search.fitted(found_by)) < least
    };
    match serves(&every, &other) && serves(&other, &every) {
        true => search.fitted(&pairs.iter().collect::<Vec<_>>()),
        false => Mount::default(),
    }
}

struct Search<'a> {
    clock: &'a Clock<'a>,
    /// Time from the timestamps of depth images to their capture, seconds.
    delay: f64,
}

impl Search<'_> {
    fn distance(&self, pairs: &[&DepthPair<'_>], mount: Mount) -> f64 {
        total_distance(pairs, &self.clock.mounted(mount), self.delay)
    }

    fn fitted(&self, pairs: &[&DepthPair<'_>]) -> Mount {
        let mut best = [0.0; N];
        let mut least = self.distance(pairs, mount_of(best));
        for _ in 0..ROUNDS {
            let parts: Vec<NormalEquations<N>> =
                pairs.par_iter().map(|pair| self.equations(pair, best)).collect();
            let mut equations = NormalEquations::ZERO;
            let expected = best.iter().zip(EXPECTED).enumerate();
            expected.for_each(|(i, (value, deviation))| equations.add_prior(i, *value, deviation));
            parts.iter().for_each(|part| equations.add(part, 1.0));
            let Some(step) = equations.solution() else { break };
            let reached = self.lowest_along(pairs, best, &step);
            if reached.1 > (1.0 - SETTLED) * least {
                break;
            }
            (best, least) = reached;
        }
        mount_of(best)
    }

    /// Returns the mount parameters with the smallest image difference along a step, and this
    /// difference. Noise makes slopes too large and steps too short, so a step is doubled while the
    /// difference decreases.
    fn lowest_along(&self, pairs: &[&DepthPair<'_>], from: Vector, step: &Vector) -> (Vector, f64) {
        let at = |times: f64| {
            let mut place = from;
            place.iter_mut().zip(step).for_each(|(x, step)| *x += times * step);
            (place, self.distance(pairs, mount_of(place)))
        };
        let mut best = at(1.0);
        for times in (1..DOUBLINGS).map(|i| f64::from(1 << i)) {
            let next = at(times);
            // NaN must not count as a fall.
            if next.1.is_nan() || next.1 >= best.1 {
                break;
            }
            best = next;
        }
        best
    }

    fn equations(&self, pair: &DepthPair<'_>, from: Vector) -> NormalEquations<N> {
        let apart = |mount: Vector| {
            pair.depth_differences(&self.clock.mounted(mount_of(mount)), self.delay)
        };
        let here = apart(from);
        let beside = |axis: usize, by: f64| {
            let mut mount = from;
            mount.iter_mut().skip(axis).take(1).for_each(|x| *x += by);
            apart(mount)
        };
        let axes = EPS.iter().enumerate();
        let sides: Vec<[Vec<Option<f64>>; 2]> =
            axes.map(|(axis, eps)| [beside(axis, *eps), beside(axis, -eps)]).collect();
        let mut equations = NormalEquations::ZERO;
        for (sample, here) in here.iter().enumerate() {
            let mut slope = [0.0; N];
            let slopes = slope.iter_mut().zip(&sides).zip(EPS).map(|((slope, sides), eps)| {
                let [more, less] = sides.each_ref().map(|side| *side.get(sample)?);
                *slope = (more? - less?) / (2.0 * eps);
                Some(())
            });
            if let (Some(()), Some(here)) = (slopes.collect(), here) {
                // An inverse variance, comparable with that of the prior.
                let weight = 1.0 / (1.0 + (here / ROBUST).powi(2)) / (ALIKE * ROBUST * ROBUST);
                equations.add_residual(*here, &slope, weight);
            }
        }
        equations
    }
}

#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in super::super) struct Mount {
    /// Translation in metres, in the frame of the tracked body, whose axes are close to the camera's.
    pub shift: DVec3,
    /// Rotation vector (axis times angle), radians.
    pub turn: DVec3,
}

impl Mount {
    pub fn camera_pose(&self, followed: &Pose) -> Pose {
        followed.attached_camera(self.shift, DQuat::from_scaled_axis(self.turn))
    }
}

/// Number of rows of a strip, and distance between sampled rows and columns, pixels.
pub(super) const EVERY: usize = 16;

/// World pose of the camera for each strip (block of rows) of an image; `None` if unknown.
pub(super) struct Strips {
    intrinsics: Intrinsics,
    poses: Vec<Option<Pose>>,
}

impl Strips {
    /// Computes the poses for an image whose middle row is read at `time`. All rows are read within
    /// `reading` seconds.
    pub fn new(clock: &Clock<'_>, time: f64, reading: f64) -> Self {
        let intrinsics = clock.intrinsics;
        let rows = intrinsics.height as usize;
        let strips = (EVERY / 2..rows).step_by(EVERY);
        let read = |row: usize| reading * ((row as f64 + 0.5) / rows as f64 - 0.5);
        Self { intrinsics, poses: strips.map(|row| clock.at(time + read(row))).collect() }
    }

    /// Returns the sampled rows for which the camera's pose during readout is known, with these poses.
    pub fn rows(&self) -> impl Iterator<Item = (usize, &Pose)> {
        let rows = (EVERY / 2..).step_by(EVERY);
        rows.zip(&self.poses).filter_map(|(row, pose)| Some((row, pose.as_ref()?)))
    }

    /// Projects a world point to pixel column, pixel row and depth. Returns `None` outside the image.
    /// The row determines the readout time and thereby the pose, so the projection is iterated. Two
    /// iterations reach pixel accuracy.
    pub fn project(&self, world: DVec3) -> Option<[f64; 3]> {
        let k = &self.intrinsics;
        // The middle strip is the best guess before the row is known.
        let (mut strip, mut seen) = (self.poses.len() / 2, None);
        for _ in 0..2 {
            let (rotation, translation) = (*self.poses.get(strip)?)?.inverse();
            let local = rotation * world + translation;
            if local.z <= 0.0 {
                return None;
            }
            let (u, v) = (k.fx * local.x / local.z + k.cx, k.fy * local.y / local.z + k.cy);
            // Negated, so that NaN is outside.
            if !(u >= 0.0 && v >= 0.0 && u < f64::from(k.width) && v < f64::from(k.height)) {
                return None;
            }
            // Rows below the last strip belong to it.
            strip = (v as usize / EVERY).min(self.poses.len() - 1);
            seen = Some([u, v, local.z]);
        }
        seen
    }
}
