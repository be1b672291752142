//! Which images of a recording tell when they were taken: those that show the same while the camera turns
//! otherwise.

use super::clock::{Clock, Shot};
use crate::math::pose::Pose;
use glam::DVec3;

/// Pairs of images that are looked at.
const PAIRS: usize = 16;
/// Images after the first of a pair among which the second is sought.
const REACH: usize = 48;
/// Radians that the camera may have turned between the two: they must show the same.
const MOST_TURN: f64 = 0.35;
/// Radians a second by which its turning must differ: in 10 ms a pixel and a half of a Kinect.
const LEAST_CHANGE: f64 = 0.3;
/// Half the seconds in which a rate of turning is measured.
const RATE: f64 = 0.01;

/// Pairs of images, evenly over the recording, each with the partner of the most different turning.
pub(super) fn chosen<'a, At>(shots: &'a [Shot], clock: &Clock<At>) -> Vec<[&'a Shot; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    let turning: Vec<Turning<'a>> =
        shots.iter().filter_map(|shot| Turning::new(shot, clock)).collect();
    let n = turning.len();
    let anchors = n.min(PAIRS);
    let pair = |i: usize| {
        let (first, behind) = turning.get(i * n / anchors..)?.split_first()?;
        let partners = behind.iter().take(REACH);
        let changes = partners.filter_map(|second| Some((second, first.change(second)?)));
        let (second, most) = changes.max_by(|x, y| x.1.total_cmp(&y.1))?;
        (most >= LEAST_CHANGE).then_some([first.shot, second.shot])
    };
    (0..anchors).filter_map(pair).collect()
}

/// An image and how its camera turns.
struct Turning<'a> {
    shot: &'a Shot,
    pose: Pose,
    /// Radians a second, axes of the world.
    rate: DVec3,
}

impl<'a> Turning<'a> {
    fn new<At>(shot: &'a Shot, clock: &Clock<At>) -> Option<Self>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let at = |by: f64| (clock.at)(shot.depth.0 + by);
        let (before, pose, after) = (at(-RATE)?, at(0.0)?, at(RATE)?);
        let turn = before.offset_to(&after).1.to_scaled_axis();
        Some(Self { shot, pose, rate: before.rotation() * turn / (2.0 * RATE) })
    }

    /// By how much the turning differs, radians a second; `None` where both hardly show the same.
    fn change(&self, other: &Self) -> Option<f64> {
        let turn = self.pose.offset_to(&other.pose).1.to_scaled_axis();
        (turn.length() < MOST_TURN).then_some((self.rate - other.rate).length())
    }
}
