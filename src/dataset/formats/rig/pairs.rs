//! Selects image pairs for the rig estimate: they show the same surfaces, and the camera's rotation rate or
//! its orientation differs between them.

use super::clock::{Clock, ImagePair};
use crate::math::pose::Pose;
use glam::DVec3;

/// Largest number of image pairs.
const PAIRS: usize = 16;
/// Images after the first of a pair that are candidates for the second.
const REACH: usize = 48;
/// Largest rotation within a pair, radians: both images must show the same surfaces.
const MOST_SHAKEN: f64 = 0.35;
const MOST_TURNED: f64 = 0.6;
/// Least difference of rotation rates, radians per second: 1.5 pixels of a Kinect in 10 ms.
const LEAST_CHANGE: f64 = 0.3;
/// Least rotation within a pair, radians: a twentieth of a common pose error remains visible within it.
const LEAST_TURN: f64 = 0.05;
/// Half the time over which a rotation rate is measured, seconds.
const RATE: f64 = 0.01;

/// Evenly spaced images, each paired with the one whose rotation rate differs most.
pub(super) fn pairs_by_rate_change<'a, At>(
    shots: &'a [ImagePair],
    clock: &Clock<At>,
) -> Vec<[&'a ImagePair; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    let change = |a: &RotatingImage<'_>, b: &RotatingImage<'_>| (a.rate - b.rate).length();
    chosen(shots, clock, MOST_SHAKEN, change, LEAST_CHANGE)
}

/// Evenly spaced images, each paired with the one that is rotated most.
pub(super) fn pairs_by_rotation<'a, At>(
    shots: &'a [ImagePair],
    clock: &Clock<At>,
) -> Vec<[&'a ImagePair; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    chosen(shots, clock, MOST_TURNED, RotatingImage::angle, LEAST_TURN)
}

/// Pairs with a rotation below `most_turn`, each with the highest score, which must reach `least`.
fn chosen<'a, At>(
    shots: &'a [ImagePair],
    clock: &Clock<At>,
    most_turn: f64,
    score: impl Fn(&RotatingImage<'a>, &RotatingImage<'a>) -> f64,
    least: f64,
) -> Vec<[&'a ImagePair; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    let turning: Vec<RotatingImage<'a>> =
        shots.iter().filter_map(|shot| RotatingImage::new(shot, clock)).collect();
    let n = turning.len();
    let anchors = n.min(PAIRS);
    let pair = |i: usize| {
        let (first, behind) = turning.get(i * n / anchors..)?.split_first()?;
        let partners = behind.iter().take(REACH).filter(|second| first.angle(second) < most_turn);
        let scores = partners.map(|second| (second, score(first, second)));
        let (second, most) = scores.max_by(|x, y| x.1.total_cmp(&y.1))?;
        (most >= least).then_some([first.shot, second.shot])
    };
    (0..anchors).filter_map(pair).collect()
}

/// An image with its camera's pose and rotation rate.
struct RotatingImage<'a> {
    shot: &'a ImagePair,
    pose: Pose,
    /// Rotation rate in world axes, radians per second.
    rate: DVec3,
}

impl<'a> RotatingImage<'a> {
    fn new<At>(shot: &'a ImagePair, clock: &Clock<At>) -> Option<Self>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let at = |by: f64| (clock.at)(shot.depth.0 + by);
        let (before, pose, after) = (at(-RATE)?, at(0.0)?, at(RATE)?);
        let turn = before.offset_to(&after).1.to_scaled_axis();
        Some(Self { shot, pose, rate: before.rotation() * turn / (2.0 * RATE) })
    }

    /// Rotation to another image, radians.
    fn angle(&self, other: &Self) -> f64 {
        self.pose.offset_to(&other.pose).1.to_scaled_axis().length()
    }
}
