//! Timestamped poses and interpolation between them.

use crate::dataset::error::FrameProblem;
use crate::math::pose::Pose;
use glam::{DMat4, DQuat, DVec3};

/// Maximum time between a frame and its pose or photograph, seconds. At 30 Hz, half a frame interval is
/// 17 ms.
pub(super) const TOLERANCE: f64 = 0.020;

#[derive(Clone, Copy, Debug)]
pub(super) struct TimedPose {
    pub time: f64,
    position: DVec3,
    turn: DQuat,
}

impl TimedPose {
    /// Creates a pose from `t tx ty tz qx qy qz qw`. Returns `None` unless all values are finite and the
    /// quaternion's length is near 1.
    pub fn new([time, x, y, z, qx, qy, qz, qw]: [f64; 8]) -> Option<Self> {
        let (position, turn) = (DVec3::new(x, y, z), DQuat::from_xyzw(qx, qy, qz, qw));
        // Rounded text stays far closer to length 1; other numbers are not a quaternion.
        let is_turn = (0.5..2.0).contains(&turn.length());
        (time.is_finite() && position.is_finite() && is_turn).then(|| Self {
            time,
            position,
            turn: turn.normalize(),
        })
    }

    pub fn matrix(&self) -> DMat4 {
        DMat4::from_rotation_translation(self.turn, self.position)
    }
}

/// Returns the lines that are neither empty nor a comment (`#`), with line numbers from 1.
pub(super) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let numbered = text.lines().enumerate().map(|(i, line)| (i + 1, line.trim()));
    numbered.filter(|(_, line)| !line.is_empty() && !line.starts_with('#'))
}

/// Sorts items by time (stable sort). Returns the number of items that were earlier than the previous
/// item.
pub(super) fn sort_by_time<T>(items: &mut [T], time: impl Fn(&T) -> f64) -> usize {
    let n = items.array_windows().filter(|[before, here]| time(here) < time(before)).count();
    items.sort_by(|a, b| time(a).total_cmp(&time(b)));
    n
}

/// Returns the error for a time that has no pose or photograph (`what`) within [`TOLERANCE`]. `nearest`
/// is the time difference to the nearest one, seconds.
pub(super) fn not_in_time(what: &'static str, time: f64, nearest: Option<f64>) -> FrameProblem {
    let found = nearest.map(|nearest| format!("the nearest {:.0} ms away", 1e3 * nearest));
    let found = found.unwrap_or_else(|| "none".to_owned());
    FrameProblem::NotInTime { what, time, tolerance_ms: 1e3 * TOLERANCE, found }
}

pub(super) struct Trajectory {
    // Ascending by time, without duplicates.
    poses: Vec<TimedPose>,
}

impl Trajectory {
    /// Sorts poses by time and removes poses with the same time as an earlier pose. Also returns the
    /// number of poses out of order and the number of removed poses.
    pub fn new(mut poses: Vec<TimedPose>) -> (Self, usize, usize) {
        let unordered = sort_by_time(&mut poses, |pose| pose.time);
        let n = poses.len();
        // Interpolation divides by the time between two poses.
        poses.dedup_by(|later, first| later.time == first.time);
        let doubled = n - poses.len();
        (Self { poses }, unordered, doubled)
    }

    pub fn end(&self) -> Option<f64> {
        self.poses.last().map(|pose| pose.time)
    }

    /// Returns the pose at a time, interpolated between the poses before and after. At either end of the
    /// trajectory, returns the nearest pose.
    ///
    /// # Errors
    /// Fails if no pose is within [`TOLERANCE`].
    pub fn at(&self, time: f64) -> Result<DMat4, FrameProblem> {
        let after = self.poses.partition_point(|pose| pose.time < time);
        let (before, after) =
            (after.checked_sub(1).and_then(|i| self.poses.get(i)), self.poses.get(after));
        let distance =
            |pose: Option<&TimedPose>| pose.map_or(f64::INFINITY, |p| (p.time - time).abs());
        let nearest = distance(before).min(distance(after));
        if nearest > TOLERANCE {
            let nearest = nearest.is_finite().then_some(nearest);
            return Err(not_in_time("a pose", time, nearest));
        }
        Ok(match (before, after) {
            (Some(a), Some(b)) => {
                let t = (time - a.time) / (b.time - a.time);
                let turn = a.turn.slerp(b.turn, t);
                DMat4::from_rotation_translation(turn, a.position.lerp(b.position, t))
            }
            (Some(only), None) | (None, Some(only)) => only.matrix(),
            // Not reached: without any pose the distance above is infinite.
            (None, None) => Pose::IDENTITY.to_opencv(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn at(time: f64, x: f64, angle: f64) -> TimedPose {
        let q = DQuat::from_rotation_z(angle);
        TimedPose::new([time, x, 0.0, 0.0, q.x, q.y, q.z, q.w]).unwrap()
    }

    #[test]
    fn poses_between_two_are_interpolated_on_the_sphere() {
        let (path, unordered, doubled) =
            Trajectory::new(vec![at(2.0, 1.0, 0.8), at(1.99, 0.0, 0.0), at(2.0, 9.0, 0.0)]);
        assert_eq!((unordered, doubled), (1, 1));
        let half = path.at(1.995).unwrap();
        let expected = DMat4::from_rotation_translation(
            DQuat::from_rotation_z(0.4),
            DVec3::new(0.5, 0.0, 0.0),
        );
        assert!(half.abs_diff_eq(expected, 1e-9), "{half}");
        assert!(path.at(2.019).unwrap().abs_diff_eq(at(0.0, 1.0, 0.8).matrix(), 1e-12));
        let error = path.at(2.5).unwrap_err().to_string();
        assert!(error.contains("within 20 ms") && error.contains("500 ms away"), "{error}");
        assert!(TimedPose::new([0.0; 8]).is_none() && TimedPose::new([f64::NAN; 8]).is_none());
    }
}
