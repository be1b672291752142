//! Alignment of a frame's samples with the rendered scene: Gauss–Newton over depth and brightness.
//!
//! Depth is compared along the normal of the rendered surface, so that a slanted floor has the same
//! weight as a wall. Brightness constrains motion along planes. Both use Cauchy weights, because frame
//! and scene can occlude parts of each other. Gradients are taken from the rendered picture, which has
//! no holes, whereas a frame can have holes.

use super::reference::ReferenceLevel;
use super::samples::{Sample, SampleLevel};
use crate::math::pose::Pose;
use crate::train::scene::rigid_equations::{Motion, RigidEquations};
use glam::{DQuat, DVec3};

/// Standard deviation of brightness between a frame and the rendered scene.
const BRIGHTNESS: f64 = 0.05;
/// Standard deviation of the positions of rendered surfaces, relative to depth.
const SURFACE: f64 = 0.004;
/// Squared residual, in units of its variance, at which the Cauchy weight is one half.
const ROBUST: f64 = 4.0;
/// Prior standard deviations of a motion: rotation in radians, and translation relative to the typical
/// depth.
const PRIOR: [f64; 2] = [0.5, 0.5];
/// Rotation (radians) and translation (relative to depth) of a step below which the iteration has
/// converged.
const SMALL_STEP: f64 = 2e-5;
/// Minimum length of a depth residual's gradient; a shorter one has no usable direction.
const MIN_SLOPE: f64 = 1e-9;

/// Fit of a frame to the scene at a pose.
#[derive(Clone, Copy, Debug)]
pub struct PoseFit {
    pub pose: Pose,
    /// Share of the samples that fall on the rendered scene.
    pub overlap: f64,
    /// Mean agreement of the samples that fall on the rendered scene, 0 to 1.
    pub agreement: f64,
    /// Standard deviations of rotation (radians) and centre (world units) along the least certain axes.
    pub deviations: [f64; 2],
}

impl PoseFit {
    /// Returns the quality of the fit, 0 to 1: overlap times agreement.
    pub fn score(&self) -> f64 {
        self.overlap * self.agreement
    }
}

struct Residual {
    /// Vector from the camera centre to the sample, in world coordinates (world units).
    arm: DVec3,
    distance: f64,
    /// Normal of the rendered surface.
    normal: DVec3,
    /// Normal of the surface as measured by the frame.
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
        // Motion along the rendered surface leaves the residual unchanged.
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

/// Returns the factor that converts the frame's brightness to the rendered brightness; 1 if there are
/// no residuals.
fn gain(residuals: &[Residual]) -> f64 {
    let (above, below) = residuals.iter().fold((0.0, 0.0), |(above, below), r| {
        let trust = r.depth_trust();
        (above + trust * r.brightness * r.shown, below + trust * r.brightness * r.brightness)
    });
    if below > 0.0 { above / below } else { 1.0 }
}

/// Returns the share of the rendered contrast that the frame also has, 0 to 1. It is the slope of a
/// regression of the frame's brightness on the rendered brightness. A uniform frame gives 0, whatever
/// the contrast of the scene.
fn shared_contrast(residuals: &[Residual], gain: f64) -> f64 {
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

/// Returns the standard deviations of rotation (radians) and centre (world units) along the least
/// certain axes. They are computed with the frame's own normals and contrast. If the frame shows
/// something other than the scene, the scene's gradients would make the pose seem too certain. `None`
/// unless all numbers are finite.
fn pose_deviations(
    residuals: &[Residual],
    gain: f64,
    alike: f64,
    deviations: [f64; 2],
) -> Option<[f64; 2]> {
    // Linearised at the pose found, from which no motion is left.
    let still = Motion { turn: DQuat::IDENTITY, shift: DVec3::ZERO };
    let mut equations = RigidEquations::prior(&still, deviations);
    let contrast = shared_contrast(residuals, gain);
    for r in residuals {
        let (depth_trust, trust) = (r.depth_trust(), r.brightness_trust(gain));
        equations.add(r.distance, r.own_normal, r.arm, depth_trust / (alike * r.variance));
        let weight = trust * depth_trust / (alike * BRIGHTNESS * BRIGHTNESS);
        let apart = r.shown - gain * r.brightness;
        equations.add(apart, contrast * r.slope, r.arm, weight);
    }
    equations.deviations()
}

/// Aligns a frame with the scene rendered from `from`, starting at the pose `start`, in at most `rounds`
/// Gauss–Newton steps. `depth` is the frame's typical depth, world units. `None` if the samples do not
/// determine a finite pose.
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
    // Ends by `return`, since the range is unbounded.
    for round in 0.. {
        let residuals = samples.iter().filter_map(|s| Residual::of(s, &pose, from, level));
        let residuals: Vec<Residual> = residuals.collect();
        let gain = gain(&residuals);
        // The prior is centred on the initial pose, so that repeated steps cannot drift away.
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
                deviations: pose_deviations(&residuals, gain, *alike, deviations)?,
            });
        }
        let step = Motion { turn: DQuat::from_scaled_axis(turn), shift };
        motion.turn = (step.turn * motion.turn).normalize();
        motion.shift += shift;
        pose = step.apply_to_pose(&pose);
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    fn residual(distance: f64, brightness: f64, shown: f64) -> Residual {
        let (arm, normal, own_normal, slope) = (DVec3::ZERO, DVec3::Z, DVec3::Z, DVec3::ZERO);
        Residual { arm, distance, normal, own_normal, variance: 0.01, brightness, shown, slope }
    }

    #[test]
    fn brightness_is_compared_where_depths_agree() {
        // A distance of two deviations halves the trust.
        let residuals =
            [residual(0.0, 0.1, 0.0), residual(-0.2, 0.2, 1.0), residual(0.0, 0.3, 0.5)];
        let near = |found: f64, expected: f64| assert!((found - expected).abs() < 1e-12, "{found}");
        near(residuals[0].depth_trust(), 1.0);
        near(residuals[1].depth_trust(), 0.5);
        // Two deviations of brightness, too.
        near(residual(0.0, 0.1, 0.3).brightness_trust(2.0), 0.5);
        near(gain(&residuals), (0.5 * 0.2 + 0.3 * 0.5) / (0.01 + 0.5 * 0.04 + 0.09));
        near(gain(&[residual(0.0, 0.0, 0.5)]), 1.0);
        // Of the weighted means, seen brightness deviates by 2/7 of what is shown.
        near(shared_contrast(&residuals, 2.0), 2.0 / 7.0);
        near(shared_contrast(&residuals, 20.0), 1.0);
        near(shared_contrast(&residuals[..1], 2.0), 0.0);
        let pose = Pose::IDENTITY;
        let fit = PoseFit { pose, overlap: 0.5, agreement: 0.25, deviations: [0.0; 2] };
        near(fit.score(), 0.125);
    }
}
