//! Which images of a recording tell of its rig: pairs that show the same, between which the camera turns
//! otherwise, or is turned.

use super::clock::{Clock, Shot};
use crate::math::pose::Pose;
use glam::DVec3;

/// Pairs of images that are looked at.
const PAIRS: usize = 16;
/// Images after the first of a pair among which the second is sought.
const REACH: usize = 48;
/// Radians that the camera may have turned between the two: they must show the same.
const MOST_SHAKEN: f64 = 0.35;
const MOST_TURNED: f64 = 0.6;
/// Radians a second by which its turning must differ: in 10 ms a pixel and a half of a Kinect.
const LEAST_CHANGE: f64 = 0.3;
/// Radians that it must have turned: a twentieth of what all poses err by is left of it within the pair.
const LEAST_TURN: f64 = 0.05;
/// Half the seconds in which a rate of turning is measured.
const RATE: f64 = 0.01;

/// Pairs of images, evenly over the recording, each with the partner of the most different turning.
pub(super) fn shaken<'a, At>(shots: &'a [Shot], clock: &Clock<At>) -> Vec<[&'a Shot; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    let change = |a: &Turning<'_>, b: &Turning<'_>| (a.rate - b.rate).length();
    chosen(shots, clock, MOST_SHAKEN, change, LEAST_CHANGE)
}

/// Pairs of images, evenly over the recording, each with the partner that is turned most.
pub(super) fn turned<'a, At>(shots: &'a [Shot], clock: &Clock<At>) -> Vec<[&'a Shot; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    chosen(shots, clock, MOST_TURNED, Turning::angle, LEAST_TURN)
}

/// Pairs with no more than so much of a turn between them, each of the highest score of at least the least.
fn chosen<'a, At>(
    shots: &'a [Shot],
    clock: &Clock<At>,
    most_turn: f64,
    score: impl Fn(&Turning<'a>, &Turning<'a>) -> f64,
    least: f64,
) -> Vec<[&'a Shot; 2]>
where
    At: Fn(f64) -> Option<Pose>,
{
    let turning: Vec<Turning<'a>> =
        shots.iter().filter_map(|shot| Turning::new(shot, clock)).collect();
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

    /// Radians by which another image is turned.
    fn angle(&self, other: &Self) -> f64 {
        self.pose.offset_to(&other.pose).1.to_scaled_axis().length()
    }
}
