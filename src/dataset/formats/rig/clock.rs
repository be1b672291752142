//! Inputs of the rig estimate: image pairs, timestamps, trajectory and readout times.

use super::mount_search::Mount;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::FrameProblem;
use crate::dataset::options::ByteSource;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Depth image and its photograph with their timestamps (seconds); both have the same intrinsics.
pub(in super::super) struct ImagePair {
    pub name: String,
    pub depth: (f64, DepthSource),
    pub color: (f64, ByteSource),
}

impl ImagePair {
    /// Reads a file of the pair. If it is unreadable, logs a warning and returns `None`. Reading is
    /// retried once, because a temporary disk error would otherwise change the estimate.
    pub fn read<T>(&self, read: impl Fn() -> Result<T, FrameProblem>) -> Option<T> {
        let told = |problem| {
            tracing::warn!(
                "frame {}: {problem}; delays are estimated from other frames",
                self.name
            );
        };
        read().or_else(|_| read()).map_err(told).ok()
    }
}

#[derive(Clone, Copy)]
pub(in super::super) struct Clock<'a> {
    /// Returns the world pose of the tracked body at a time (seconds); `None` if it is unknown.
    pub tracked: &'a (dyn Fn(f64) -> Option<Pose> + Sync),
    /// Mount of the camera on the body; `None` if tracked poses are camera poses.
    pub mount: Option<Mount>,
    pub intrinsics: Intrinsics,
    /// Readout time from the first to the last row of a depth image, seconds. The timestamp is that of
    /// the middle row.
    pub depth_reading: f64,
    pub color_reading: f64,
}

impl Clock<'_> {
    pub fn at(&self, time: f64) -> Option<Pose> {
        let tracked = (self.tracked)(time)?;
        Some(self.mount.map_or(tracked, |mount| mount.camera_pose(&tracked)))
    }

    pub fn mounted(&self, mount: Mount) -> Self {
        Self { mount: Some(mount), ..*self }
    }

    /// Returns the same clock for cameras that read all rows of an image at once.
    pub fn without_readout(&self) -> Self {
        Self { depth_reading: 0.0, color_reading: 0.0, ..*self }
    }
}

/// Minimum number of image pairs for an estimate.
const FEWEST: usize = 6;
/// Step between tested delays, seconds. [`N_STEPS`] delays of either sign are tested.
const STEP: f64 = 0.005;
const N_STEPS: usize = 8;
/// Minimum relative decrease of the mean difference within image pairs for accepting a delay.
const FALL: f64 = 0.05;
/// Maximum difference, in seconds, between the delays estimated from two halves of the pairs.
const AGREED: f64 = 0.008;
/// Minimum delay that is reported, seconds.
const LEAST: f64 = 0.004;

/// Estimates the time from timestamps to capture, seconds: the delay with the smallest sum of
/// `distance` (difference within a pair) over all pairs. `None` if it is undetermined or negligible.
pub(super) fn estimate_delay<P: Sync>(
    pairs: &[P],
    distance: impl Fn(&P, f64) -> f64 + Sync,
) -> Option<f64> {
    if pairs.len() < FEWEST {
        return None;
    }
    let table: Vec<Distances> = pairs
        .par_iter()
        .map(|pair| std::array::from_fn(|i| distance(pair, delay_of(i as f64))))
        .collect();
    // Every other pair, so that both halves span the recording.
    let half = |first: usize| sum(table.iter().skip(first).step_by(2));
    let all = sum(table.iter());
    let (delay, least) = lowest(&all)?;
    let halves = [lowest(&half(0))?.0, lowest(&half(1))?.0];
    // The entry in the middle is that without delay.
    let is_determined =
        least < (1.0 - FALL) * all[N_STEPS] && (halves[0] - halves[1]).abs() < AGREED;
    (is_determined && delay.abs() >= LEAST).then_some(delay)
}

type Distances = [f64; 2 * N_STEPS + 1];

fn delay_of(place: f64) -> f64 {
    (place - N_STEPS as f64) * STEP
}

fn sum<'a>(rows: impl Iterator<Item = &'a Distances>) -> Distances {
    rows.fold([0.0; _], |mut sums, row| {
        sums.iter_mut().zip(row).for_each(|(sum, distance)| *sum += distance);
        sums
    })
}

/// Returns the delay (seconds) with the smallest distance, and this distance. Returns `None` if this
/// delay is an end of the tested range, because the minimum may be outside the range.
fn lowest(distances: &Distances) -> Option<(f64, f64)> {
    let triples = distances.array_windows().enumerate();
    let (before, [left, here, right]) = triples.min_by(|(_, a), (_, b)| a[1].total_cmp(&b[1]))?;
    if left < here || right < here {
        return None;
    }
    // Vertex of the parabola through the three distances.
    let bend = left - 2.0 * here + right;
    let off = if bend > 0.0 { 0.5 * (left - right) / bend } else { 0.0 };
    Some((delay_of(before as f64 + 1.0 + off), *here))
}

const PAIRS: usize = 16;
/// Number of images following the first image of a pair that are candidates for the second.
const REACH: usize = 48;
/// Maximum rotation between the images of a pair, radians. Both images must show the same surfaces.
const MOST_SHAKEN: f64 = 0.35;
const MOST_TURNED: f64 = 0.6;
/// Minimum difference between the rotation rates of a pair's images, radians per second. It shifts a
/// Kinect's image by 1.5 pixels in 10 ms.
const LEAST_CHANGE: f64 = 0.3;
/// Minimum rotation between the images of a pair, radians. At this rotation, a twentieth of an error
/// common to both poses remains as a difference between the images.
const LEAST_TURN: f64 = 0.05;
/// Half of the interval over which a rotation rate is measured, seconds.
const RATE: f64 = 0.01;

/// Pairs evenly spaced images, each with the image whose rotation rate differs most.
pub(super) fn pairs_by_rate_change<'a>(
    shots: &'a [ImagePair],
    clock: &Clock<'_>,
) -> Vec<[&'a ImagePair; 2]> {
    let change = |a: &RotatingImage<'_>, b: &RotatingImage<'_>| (a.rate - b.rate).length();
    chosen(shots, clock, MOST_SHAKEN, change, LEAST_CHANGE)
}

/// Pairs evenly spaced images, each with the image that is rotated most relative to it.
pub(super) fn pairs_by_rotation<'a>(
    shots: &'a [ImagePair],
    clock: &Clock<'_>,
) -> Vec<[&'a ImagePair; 2]> {
    chosen(shots, clock, MOST_TURNED, RotatingImage::angle, LEAST_TURN)
}

/// Pairs evenly spaced images, each with the later image for which `score` is highest. That score is at
/// least `least`; the rotation within a pair is below `most_turn`, radians.
fn chosen<'a>(
    shots: &'a [ImagePair],
    clock: &Clock<'_>,
    most_turn: f64,
    score: impl Fn(&RotatingImage<'a>, &RotatingImage<'a>) -> f64,
    least: f64,
) -> Vec<[&'a ImagePair; 2]> {
    let turning: Vec<RotatingImage<'a>> =
        shots.iter().filter_map(|shot| RotatingImage::new(shot, clock)).collect();
    let n = turning.len();
    let anchors = n.min(PAIRS);
    // Evenly spaced anchors: the estimate then holds for the whole recording.
    let pair = |i: usize| {
        let (first, behind) = turning.get(i * n / anchors..)?.split_first()?;
        let partners = behind.iter().take(REACH).filter(|second| first.angle(second) < most_turn);
        let scores = partners.map(|second| (second, score(first, second)));
        let (second, most) = scores.max_by(|x, y| x.1.total_cmp(&y.1))?;
        (most >= least).then_some([first.shot, second.shot])
    };
    (0..anchors).filter_map(pair).collect()
}

struct RotatingImage<'a> {
    shot: &'a ImagePair,
    pose: Pose,
    /// Rotation rate about the world axes, radians per second.
    rate: DVec3,
}

impl<'a> RotatingImage<'a> {
    fn new(shot: &'a ImagePair, clock: &Clock<'_>) -> Option<Self> {
        let at = |by: f64| clock.at(shot.depth.0 + by);
        let (before, pose, after) = (at(-RATE)?, at(0.0)?, at(RATE)?);
        let turn = before.offset_to(&after).1.to_scaled_axis();
        // In world axes, so that rates at different poses compare.
        Some(Self { shot, pose, rate: before.rotation() * turn / (2.0 * RATE) })
    }

    fn angle(&self, other: &Self) -> f64 {
        self.pose.offset_to(&other.pose).1.to_scaled_axis().length()
    }
}
