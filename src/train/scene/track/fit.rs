//! Alignment of a frame's samples with what the scene shows: Gauss–Newton over depth and brightness.
//!
//! Depth is compared across the surface that the reference shows, so that a slanted floor weighs as
//! a wall does; brightness holds what planes leave free. Both have Cauchy weights, since the scene
//! hides some of what the frame sees and the other way round. The reference is what has slopes: it
//! is drawn without holes, a frame is not.

use super::reference::ReferenceLevel;
use super::samples::{Sample, SampleLevel};
use crate::math::pose::Pose;
use crate::train::scene::rigid_equations::{Motion, RigidEquations};
use glam::{DQuat, DVec3};

/// Standard deviation of brightness between a frame and what the scene shows.
const BRIGHTNESS: f64 = 0.05;
/// Standard deviation of the scene's surfaces, as a share of depth.
const SURFACE: f64 = 0.004;
/// Squared residual, in its variances, at which a weight is a half.
const ROBUST: f64 = 4.0;
/// Standard deviation of a motion before anything is seen: radians, and as a share of depth.
const PRIOR: [f64; 2] = [0.5, 0.5];
/// A step below so many radians, or shares of depth, is none.
const SMALL_STEP: f64 = 2e-5;
/// Slope of depth beyond which a surface is seen from its edge.
const MIN_SLOPE: f64 = 1e-9;

/// How a frame fits the scene at a pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseFit {
    /// The pose.
    pub pose: Pose,
    /// Share of the samples that lie where the scene shows something.
    pub overlap: f64,
    /// Mean agreement of these, 0 to 1.
    pub agreement: f64,
    /// Deviations of turn (radians) and centre (world units) along the least certain axes.
    pub deviations: [f64; 2],
}

impl PoseFit {
    /// What the better of two fits has more of: agreement over the whole frame.
    pub fn score(&self) -> f64 {
        self.overlap * self.agreement
    }
}

/// What one sample says at a pose.
struct Residual {
    /// From the camera, world axes.
    arm: DVec3,
    distance: f64,
    /// Of the surface that the scene shows.
    normal: DVec3,
    /// Of the frame's own surface.
    own_normal: DVec3,
    variance: f64,
    brightness: f64,
    shown: f64,
    slope: DVec3,
}

impl Residual {
    fn of(sample: &Sample, pose: &Pose, from: &Pose, level: &ReferenceLevel) -> Option<Self> {
        let rotation = from.rotation();
        let arm = pose.rotation() * sample.position;
        let seen = rotation.transpose() * (arm + pose.centre() - from.centre());
        let texel = level.at(seen)?;
        // Moving away by what the surface recedes leaves the residual as it is.
        let slope = texel.depth_slope - DVec3::Z;
        let length = slope.length();
        if length < MIN_SLOPE {
            return None;
        }
        let surface = SURFACE * texel.depth;
        Some(Self {
            arm,
            distance: (texel.depth - seen.z) / length,
            normal: rotation * (slope / length),
            own_normal: pose.rotation() * sample.normal,
            variance: sample.noise * sample.noise + surface * surface,
            brightness: sample.brightness,
            shown: texel.brightness,
            slope: rotation * texel.brightness_slope,
        })
    }

    fn depth_trust(&self) -> f64 {
        1.0 / (1.0 + self.distance * self.distance / (self.variance * ROBUST))
    }

    fn brightness_trust(&self, gain: f64) -> f64 {
        let apart = self.shown - gain * self.brightness;
        1.0 / (1.0 + apart * apart / (BRIGHTNESS * BRIGHTNESS * ROBUST))
    }
}

/// The factor on the brightness of samples that lie on what the scene shows; 1 without any.
fn gain(residuals: &[Residual]) -> f64 {
    let (above, below) = residuals.iter().fold((0.0, 0.0), |(above, below), r| {
        let trust = r.depth_trust();
        (above + trust * r.brightness * r.shown, below + trust * r.brightness * r.brightness)
    });
    if below > 0.0 { above / below } else { 1.0 }
}

/// How much of the contrast that the scene shows the frame has as well, 0 to 1: the slope of its brightness
/// over the scene's. A frame of one colour tells nothing by its brightness, however painted the scene is.
fn contrast(residuals: &[Residual], gain: f64) -> f64 {
    let mut sums = [0.0; 5];
    for r in residuals {
        let (trust, seen) = (r.depth_trust(), gain * r.brightness);
        let terms = [1.0, r.shown, seen, r.shown * r.shown, r.shown * seen];
        sums.iter_mut().zip(terms).for_each(|(sum, term)| *sum += trust * term);
    }
    let [n, shown, seen, shown_twice, both] = sums;
    let (variance, covariance) = (shown_twice * n - shown * shown, both * n - shown * seen);
    if variance > 0.0 { (covariance / variance).clamp(0.0, 1.0) } else { 0.0 }
}

/// Standard deviations of turn (radians) and centre (world units) along the axes that the residuals of one
/// pose leave least certain, by the frame's own surfaces and contrast: where it shows another thing than the
/// scene, the scene's would tell of a pose that the frame knows nothing of. `None` unless all numbers are
/// finite.
fn certain(
    residuals: &[Residual],
    gain: f64,
    alike: f64,
    deviations: [f64; 2],
) -> Option<[f64; 2]> {
    let still = Motion { turn: DQuat::IDENTITY, shift: DVec3::ZERO };
    let mut equations = RigidEquations::prior(&still, deviations);
    let contrast = contrast(residuals, gain);
    for r in residuals {
        let (depth_trust, trust) = (r.depth_trust(), r.brightness_trust(gain));
        equations.add(r.distance, r.own_normal, r.arm, depth_trust / (alike * r.variance));
        let weight = trust * depth_trust / (alike * BRIGHTNESS * BRIGHTNESS);
        let apart = r.shown - gain * r.brightness;
        equations.add(apart, contrast * r.slope, r.arm, weight);
    }
    equations.deviations()
}

/// Moves a frame from `start` to where its samples fit the scene as drawn from `from`, in at most so
/// many steps; `depth` is the frame's usual depth, world units.
pub fn fit(
    SampleLevel { samples, alike }: &SampleLevel,
    (level, from): (&ReferenceLevel, &Pose),
    start: &Pose,
    rounds: usize,
    depth: f64,
) -> Option<PoseFit> {
    let mut pose = *start;
    let mut motion = Motion { turn: DQuat::IDENTITY, shift: DVec3::ZERO };
    let deviations = [PRIOR[0], PRIOR[1] * depth];
    for round in 0.. {
        let residuals = samples.iter().filter_map(|s| Residual::of(s, &pose, from, level));
        let residuals: Vec<Residual> = residuals.collect();
        let gain = gain(&residuals);
        let mut equations = RigidEquations::prior(&motion, deviations);
        let mut agreement = 0.0;
        for r in &residuals {
            let (depth_trust, trust) = (r.depth_trust(), r.brightness_trust(gain));
            equations.add(r.distance, r.normal, r.arm, depth_trust / (alike * r.variance));
            let weight = trust * depth_trust / (alike * BRIGHTNESS * BRIGHTNESS);
            equations.add(r.shown - gain * r.brightness, r.slope, r.arm, weight);
            agreement += depth_trust * trust;
        }
        let [turn, shift] = equations.solution()?;
        let is_done = turn.length() < SMALL_STEP && shift.length() < SMALL_STEP * depth;
        if round >= rounds || is_done {
            let n = residuals.len() as f64;
            return Some(PoseFit {
                pose,
                overlap: n / samples.len().max(1) as f64,
                agreement: agreement / n.max(1.0),
                deviations: certain(&residuals, gain, *alike, deviations)?,
            });
        }
        let step = Motion { turn: DQuat::from_scaled_axis(turn), shift };
        motion.turn = (step.turn * motion.turn).normalize();
        motion.shift += shift;
        pose = step.of_pose(&pose);
    }
    None
}
