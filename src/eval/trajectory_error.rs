//! Error of a tracked trajectory against a recorded one.
//!
//! The two have different world frames, so the tracked one is first aligned by a rigid motion without scale
//! (Horn's absolute orientation). The remaining error is the absolute trajectory error of the TUM
//! benchmark.

use crate::math::pose::{Pose, best_rotation};
use glam::{DMat3, DVec3};
use serde::{Deserialize, Serialize};

/// Distances between tracked and recorded cameras after rigid alignment.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct TrajectoryError {
    /// Number of compared cameras.
    pub frames: usize,
    /// Root mean square distance between tracked and recorded centres, world units: the absolute
    /// trajectory error.
    pub rmse: f64,
    /// Maximum distance between a tracked and a recorded centre, world units.
    pub max: f64,
    /// Root mean square angle between the orientations, degrees.
    pub turn_rmse_deg: f64,
}

impl TrajectoryError {
    /// Computes the error from pairs of a tracked and a recorded pose; `None` for fewer than three pairs,
    /// which do not determine an alignment.
    ///
    /// ```
    /// use glam::{DQuat, DVec3};
    /// use vbgs_studio::eval::trajectory_error::TrajectoryError;
    /// use vbgs_studio::math::pose::Pose;
    ///
    /// let at = |x, y, z| Pose::IDENTITY.attached_camera(DVec3::new(x, y, z), DQuat::from_rotation_y(x));
    /// let recorded = [at(0.0, 0.0, 0.0), at(1.0, 0.0, 0.0), at(1.0, 2.0, 0.0), at(0.0, 1.0, 1.0)];
    /// let world = at(0.3, -1.0, 2.0);
    /// let moved = |pose: &Pose| {
    ///     let turn = DQuat::from_mat3(&pose.rotation());
    ///     (world.attached_camera(pose.centre(), turn), *pose)
    /// };
    /// let error = TrajectoryError::of(&recorded.each_ref().map(moved)).ok_or("too few")?;
    /// assert!(error.rmse < 1e-9 && error.turn_rmse_deg < 1e-5);
    /// # Ok::<(), Box<dyn std::error::Error>>(())
    /// ```
    pub fn of(pairs: &[(Pose, Pose)]) -> Option<Self> {
        if pairs.len() < 3 {
            return None;
        }
        let n = pairs.len() as f64;
        let mean = |centre: fn(&(Pose, Pose)) -> DVec3| pairs.iter().map(centre).sum::<DVec3>() / n;
        let tracked_mean = mean(|pair| pair.0.centre());
        let recorded_mean = mean(|pair| pair.1.centre());
        let spread = pairs.iter().fold(DMat3::ZERO, |sum, (tracked, recorded)| {
            let (from, to) = (tracked.centre() - tracked_mean, recorded.centre() - recorded_mean);
            sum + DMat3::from_cols(to * from.x, to * from.y, to * from.z)
        });
        let rotation = best_rotation(spread);
        let distance = |(tracked, recorded): &(Pose, Pose)| {
            let moved = rotation * (tracked.centre() - tracked_mean) + recorded_mean;
            moved.distance(recorded.centre())
        };
        // Orientations get an alignment of their own: a short path hardly determines the rotation.
        let turns = pairs
            .iter()
            .map(|(tracked, recorded)| recorded.rotation() * tracked.rotation().transpose());
        let turn = best_rotation(turns.fold(DMat3::ZERO, |sum, turn| sum + turn));
        let angle = |(tracked, recorded): &(Pose, Pose)| {
            let left = recorded.rotation().transpose() * turn * tracked.rotation();
            let trace = left.x_axis.x + left.y_axis.y + left.z_axis.z;
            // Rounding may push the cosine beyond 1.
            (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos()
        };
        let root = |squares: f64| (squares / n).sqrt();
        Some(Self {
            frames: pairs.len(),
            rmse: root(pairs.iter().map(|pair| distance(pair).powi(2)).sum()),
            max: pairs.iter().map(distance).fold(0.0, f64::max),
            turn_rmse_deg: root(pairs.iter().map(|pair| angle(pair).powi(2)).sum()).to_degrees(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn centres_beside_the_path_are_the_error() {
        let at = |x: f64, y: f64, z: f64| {
            Pose::IDENTITY.attached_camera(DVec3::new(x, y, z), DQuat::from_rotation_x(x + y))
        };
        let recorded: Vec<Pose> =
            (0..20).map(f64::from).map(|i| at(i.sin(), (2.0 * i).cos(), 0.1 * i)).collect();
        let world = at(1.0, -2.0, 0.4);
        let pair = |pose: &Pose, off: DVec3| {
            let turn = DQuat::from_mat3(&pose.rotation());
            (world.attached_camera(pose.centre() + off, turn), *pose)
        };
        let sides = recorded.iter().zip([DVec3::Z, DVec3::NEG_Z].iter().cycle());
        let pairs: Vec<(Pose, Pose)> = sides.map(|(pose, side)| pair(pose, 0.01 * side)).collect();
        let error = TrajectoryError::of(&pairs).unwrap();
        assert!((error.rmse - 0.01).abs() < 5e-4, "{error:?}");
        assert_eq!(TrajectoryError::of(&pairs[..2]), None);
    }
}
