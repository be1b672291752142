//! When depth images were taken, told by the depth itself: a clock that stamps them late shows where the
//! camera turns.
//!
//! Depth of one image, moved by the trajectory into another, lies on what that one measured if both were
//! taken when their times say. A camera that turns evenly says nothing, since a delay moves both alike: pairs
//! are chosen between which it turns otherwise. Of delays in steps the one of the least mean distance is
//! taken, and refined by a parabola, if two halves of the pairs agree about it.

use super::recording::RecordedFrame;
use crate::dataset::decode;
use crate::dataset::depth::{Depth, DepthKind};
use crate::dataset::entry::DepthSource;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DVec3;
use rayon::prelude::*;

/// Pairs of images that are looked at, and the fewest that say anything.
const PAIRS: [usize; 2] = [16, 6];
/// Images after the first of a pair among which the second is sought.
const REACH: usize = 48;
/// Radians that the camera may have turned between the two: they must show the same.
const MOST_TURN: f64 = 0.35;
/// Radians a second by which its turning must differ: in 10 ms a pixel and a half of a Kinect.
const LEAST_CHANGE: f64 = 0.3;
/// Half the seconds in which a rate of turning is measured.
const RATE: f64 = 0.01;
/// Seconds between the delays that are tried, and how many to either side.
const STEP: f64 = 0.005;
const N_STEPS: usize = 8;
/// Rows and columns of depth of which every so-many-th is a sample.
const EVERY: usize = 16;
/// Distances count as shares of the depth, at most this: edges hide and show.
const FARTHEST: f64 = 0.05;
/// By what share the mean distance must fall, seconds by which two halves of the pairs may differ, and the least
/// delay that is told.
const FALL: f64 = 0.05;
const AGREED: f64 = 0.008;
const LEAST: f64 = 0.004;

/// How the camera moved, and how it reads depth.
pub(super) struct Clock<At> {
    /// World pose at a time, where it is known.
    pub at: At,
    /// Seconds from the first row of an image to the last, whose middle row is read at its time.
    pub reading: f64,
}

/// Seconds by which depth was taken after its times; negative before them. `None` where the recording does
/// not determine it, or determines that there is none.
pub(super) fn find<At>(frames: &[RecordedFrame], clock: &Clock<At>) -> Option<f64>
where
    At: Fn(f64) -> Option<Pose> + Sync,
{
    let pairs: Vec<Pair> = chosen(frames, clock)
        .into_par_iter()
        .filter_map(|[a, b]| Some(Pair([Seen::load(a)?, Seen::load(b)?])))
        .collect();
    if pairs.len() < PAIRS[1] {
        return None;
    }
    let table: Vec<Distances> = pairs
        .par_iter()
        .map(|pair| std::array::from_fn(|i| pair.distance(clock, delay_of(i as f64))))
        .collect();
    let half = |first: usize| sum(table.iter().skip(first).step_by(2));
    let all = sum(table.iter());
    let (delay, least) = lowest(&all)?;
    let halves = [lowest(&half(0))?.0, lowest(&half(1))?.0];
    let is_determined =
        least < (1.0 - FALL) * all[N_STEPS] && (halves[0] - halves[1]).abs() < AGREED;
    (is_determined && delay.abs() >= LEAST).then_some(delay)
}

/// By delay: see [`delay_of`].
type Distances = [f64; 2 * N_STEPS + 1];

/// Seconds of a place among the distances.
fn delay_of(place: f64) -> f64 {
    (place - N_STEPS as f64) * STEP
}

fn sum<'a>(rows: impl Iterator<Item = &'a Distances>) -> Distances {
    rows.fold([0.0; _], |mut sums, row| {
        sums.iter_mut().zip(row).for_each(|(sum, distance)| *sum += distance);
        sums
    })
}

/// The delay of the least distance and that distance; `None` at either end, where less may lie beyond.
fn lowest(distances: &Distances) -> Option<(f64, f64)> {
    let triples = distances.array_windows().enumerate();
    let (before, [left, here, right]) = triples.min_by(|(_, a), (_, b)| a[1].total_cmp(&b[1]))?;
    if left < here || right < here {
        return None;
    }
    let bend = left - 2.0 * here + right;
    let off = if bend > 0.0 { 0.5 * (left - right) / bend } else { 0.0 };
    Some((delay_of(before as f64 + 1.0 + off), *here))
}

/// Pairs of images, evenly over the recording, each with the partner of the most different turning.
fn chosen<'a, At>(frames: &'a [RecordedFrame], clock: &Clock<At>) -> Vec<[&'a RecordedFrame; 2]>
where
    At: Fn(f64) -> Option<Pose> + Sync,
{
    let turning: Vec<Turning<'a>> =
        frames.iter().filter_map(|frame| Turning::new(frame, clock)).collect();
    let n = turning.len();
    let anchors = n.min(PAIRS[0]);
    let pair = |i: usize| {
        let (first, behind) = turning.get(i * n / anchors..)?.split_first()?;
        let partners = behind.iter().take(REACH);
        let changes = partners.filter_map(|second| Some((second, first.change(second)?)));
        let (second, most) = changes.max_by(|x, y| x.1.total_cmp(&y.1))?;
        (most >= LEAST_CHANGE).then_some([first.frame, second.frame])
    };
    (0..anchors).filter_map(pair).collect()
}

/// A frame and how its camera turns.
struct Turning<'a> {
    frame: &'a RecordedFrame,
    /// Radians a second, axes of the world.
    rate: DVec3,
}

impl<'a> Turning<'a> {
    fn new<At>(frame: &'a RecordedFrame, clock: &Clock<At>) -> Option<Self>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let at = |by: f64| (clock.at)(frame.time? + by);
        let (before, after) = (at(-RATE)?, at(RATE)?);
        let turn = before.offset_to(&after).1.to_scaled_axis();
        Some(Self { frame, rate: before.rotation() * turn / (2.0 * RATE) })
    }

    /// By how much the turning differs, radians a second; `None` where both hardly show the same.
    fn change(&self, other: &Self) -> Option<f64> {
        let turn = self.frame.pose.offset_to(&other.frame.pose).1.to_scaled_axis();
        (turn.length() < MOST_TURN).then_some((self.rate - other.rate).length())
    }
}

/// A depth image.
struct Seen {
    time: f64,
    depth: Depth,
    intrinsics: Intrinsics,
}

impl Seen {
    fn load(frame: &RecordedFrame) -> Option<Self> {
        let DepthSource { file, encoding, .. } = frame.depth.as_ref()?;
        let intrinsics = frame.cameras.depth;
        let size = (intrinsics.width, intrinsics.height);
        // Twice, as all that settings are chosen by: what a disk refuses once is learnt from later.
        let read = || decode::depth(file, encoding, size);
        let depth = match read().or_else(|_| read()) {
            Ok(depth) => depth,
            Err(problem) => {
                tracing::warn!(
                    "frame {}: {problem}; the delay of depth is told by others",
                    frame.name
                );
                return None;
            }
        };
        // What a Kinect measures; other depth would need its own rays.
        (depth.kind == DepthKind::Z).then_some(Self { time: frame.time?, depth, intrinsics })
    }

    /// Where the camera was when it read each strip of [`EVERY`] rows.
    fn poses<At>(&self, clock: &Clock<At>, delay: f64) -> Vec<Option<Pose>>
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let rows = self.intrinsics.height as usize;
        let strips = (EVERY / 2..rows).step_by(EVERY);
        let read = |row: usize| clock.reading * ((row as f64 + 0.5) / rows as f64 - 0.5);
        strips.map(|row| (clock.at)(self.time + delay + read(row))).collect()
    }

    fn trusted(&self, column: usize, row: usize) -> Option<f64> {
        self.depth.value_at(column, row).filter(|&z| self.depth.trusts(z))
    }
}

/// Two images of the same surfaces.
struct Pair([Seen; 2]);

impl Pair {
    /// Mean distance of the first one's depth from the second one's, as a share of the depth.
    fn distance<At>(&self, clock: &Clock<At>, delay: f64) -> f64
    where
        At: Fn(f64) -> Option<Pose>,
    {
        let Self([a, b]) = self;
        let (from, to) = (a.poses(clock, delay), b.poses(clock, delay));
        let k = &a.intrinsics;
        let (mut sum, mut n) = (0.0, 0.0);
        for (row, pose) in (EVERY / 2..k.height as usize).step_by(EVERY).zip(&from) {
            let Some(pose) = pose else { continue };
            for column in (EVERY / 2..k.width as usize).step_by(EVERY) {
                let Some(z) = a.trusted(column, row) else { continue };
                let world = pose.transform_point(k.ray(column, row) * z);
                let Some((found, expected)) = measured(b, &to, world) else { continue };
                sum += ((found - expected).abs() / expected).min(FARTHEST);
                n += 1.0;
            }
        }
        if n > 0.0 { sum / n } else { FARTHEST }
    }
}

/// Depth that an image measured where a world point is seen, and that of the point. Its row says when it was
/// seen, and that where: twice round is enough for a pixel.
fn measured(image: &Seen, poses: &[Option<Pose>], world: DVec3) -> Option<(f64, f64)> {
    let k = &image.intrinsics;
    let (mut strip, mut seen) = (poses.len() / 2, None);
    for _ in 0..2 {
        let (rotation, translation) = (*poses.get(strip)?)?.inverse();
        let local = rotation * world + translation;
        if local.z <= 0.0 {
            return None;
        }
        let (u, v) = (k.fx * local.x / local.z + k.cx, k.fy * local.y / local.z + k.cy);
        if !(u >= 0.0 && v >= 0.0 && u < f64::from(k.width) && v < f64::from(k.height)) {
            return None;
        }
        strip = (v as usize / EVERY).min(poses.len() - 1);
        seen = Some((u as usize, v as usize, local.z));
    }
    let (column, row, z) = seen?;
    Some((image.trusted(column, row)?, z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::decode::{CodeKind, DepthEncoding};
    use crate::dataset::distortion::Distortion;
    use crate::dataset::formats::recording::Cameras;
    use crate::dataset::source::ByteSource;
    use crate::dataset::surface::sensor::Sensor;
    use glam::{DQuat, EulerRot};
    use std::path::Path;

    const READING: f64 = 0.03;
    /// Half the sides of a room, metres.
    const ROOM: DVec3 = DVec3::new(2.0, 1.4, 3.1);

    fn pose(turn: DQuat) -> Pose {
        let matrix = glam::DMat4::from_rotation_translation(turn, DVec3::new(0.3, -0.2, 0.4));
        Pose::from_opencv(matrix).unwrap()
    }

    /// Shaken by half a radian a second about two axes.
    fn shaken(time: f64) -> Option<Pose> {
        let (yaw, pitch) = (0.15 * (4.1 * time).sin(), 0.12 * (5.3 * time).cos());
        Some(pose(DQuat::from_euler(EulerRot::YXZ, yaw, pitch, 0.0)))
    }

    /// Turned as evenly as can be.
    fn even(time: f64) -> Option<Pose> {
        Some(pose(DQuat::from_rotation_y(0.5 * time)))
    }

    /// Depth of the room's walls, row by row as it is read.
    fn depth(k: &Intrinsics, time: f64, at: impl Fn(f64) -> Option<Pose>) -> Vec<u8> {
        let rows = k.height as usize;
        let mut bytes = Vec::new();
        for row in 0..rows {
            let read = READING * ((row as f64 + 0.5) / rows as f64 - 0.5);
            let pose = at(time + read).unwrap();
            for column in 0..k.width as usize {
                let (from, along) = (pose.centre(), pose.rotation() * k.ray(column, row));
                let wall = (ROOM * along.signum() - from) / along;
                bytes.extend((wall.min_element() as f32).to_le_bytes());
            }
        }
        bytes
    }

    /// Frames whose times are `delay` before those at which their depth was measured.
    fn recorded(folder: &Path, delay: f64, at: impl Fn(f64) -> Option<Pose>) -> Vec<RecordedFrame> {
        let k = Intrinsics::from_horizontal_fov(160, 128, 1.0);
        let frame = |i: usize| {
            let (time, file) = (0.13 * i as f64, folder.join(format!("{i}.depth")));
            std::fs::write(&file, depth(&k, time + delay, &at)).unwrap();
            let encoding = DepthEncoding {
                codes: CodeKind::BareFloats,
                kind: DepthKind::Z,
                trusted: [0.1, 10.0],
                metre: 1.0,
                sensor: Sensor::Kinect,
            };
            RecordedFrame {
                name: i.to_string(),
                time: Some(time),
                pose: at(time).unwrap(),
                cameras: Cameras { depth: k, color: None },
                color: ByteSource::Grey(file.clone()),
                depth: Some(DepthSource {
                    file: ByteSource::File(file),
                    encoding,
                    confidence: None,
                }),
                lens: Distortion::default(),
            }
        };
        (0..24).map(frame).collect()
    }

    fn found(delay: f64, at: impl Fn(f64) -> Option<Pose> + Copy + Sync) -> Option<f64> {
        let folder = tempfile::tempdir().unwrap();
        find(&recorded(folder.path(), delay, at), &Clock { at, reading: READING })
    }

    #[test]
    fn a_late_clock_shows_where_the_camera_is_shaken() {
        for delay in [-0.026, 0.012] {
            let found = found(delay, shaken).expect("determined");
            assert!((found - delay).abs() < 2e-3, "{found} for {delay}");
        }
    }

    #[test]
    fn nothing_is_told_where_there_is_no_delay_nothing_to_tell_it_by_or_too_much() {
        assert_eq!(found(0.0, shaken), None);
        assert_eq!(found(-0.026, even), None, "both of every pair move alike");
        assert_eq!(found(-0.06, shaken), None, "the least lies beyond what is tried");
        assert_eq!(find(&[], &Clock { at: shaken, reading: READING }), None);
    }
}
