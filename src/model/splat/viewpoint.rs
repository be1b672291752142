//! Where frames were taken from, and how much each of them says of a view near by.

use crate::math::pose::Pose;
use bytemuck::{Pod, Zeroable};
use glam::DVec3;

/// Angle between view directions, radians, at which a frame counts for less by `exp(−½)`.
const ANGLE: f64 = 0.1;
/// Distance between cameras, structural scales, at which a frame counts for less by `exp(−½)`.
pub const DISTANCE: f64 = 4.0;

/// Where a frame was taken from.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct Viewpoint {
    /// Where its camera stood, world units.
    pub centre: [f64; 3],
    /// Unit direction it looked in, world axes.
    pub forward: [f64; 3],
}

impl Viewpoint {
    /// That of a camera.
    pub fn new(pose: &Pose) -> Self {
        Self { centre: pose.centre().to_array(), forward: pose.forward().to_array() }
    }

    /// Squared distance from a pose, one for a frame that counts for less by `exp(−½)`.
    fn squared_distance(&self, pose: &Pose, reach: f64) -> f64 {
        let apart = DVec3::from_array(self.centre).distance(pose.centre()) / reach;
        let angle = DVec3::from_array(self.forward).angle_between(pose.forward()) / ANGLE;
        apart * apart + angle * angle
    }
}

/// Mean over frames of what they say at `pose`, by Gaussian weights relative to the nearest frame's
/// (Nadaraya and Watson's regression); `None` without frames. `reach` is the distance between cameras at
/// which a frame counts for less by `exp(−½)`, world units.
pub fn regress<T, const N: usize>(
    frames: &[T],
    pose: &Pose,
    reach: f64,
    said: impl Fn(&T) -> (Viewpoint, [f64; N]),
) -> Option<[f64; N]> {
    let away = |frame: &T| said(frame).0.squared_distance(pose, reach);
    let nearest = frames.iter().map(away).fold(f64::INFINITY, f64::min);
    let (mut total, mut sums) = (0.0, [0.0; N]);
    for frame in frames {
        // Relative to the nearest frame: far from all of them every weight alone would underflow.
        let weight = (0.5 * (nearest - away(frame))).exp();
        total += weight;
        sums.iter_mut().zip(said(frame).1).for_each(|(sum, value)| *sum += weight * value);
    }
    (total > 0.0).then(|| sums.map(|sum| sum / total))
}
