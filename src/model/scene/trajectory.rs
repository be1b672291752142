//! Tracked camera poses, for recordings without poses.

use crate::math::pose::{Pose, unit_rotation};
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Tracked camera pose of one frame and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub struct TrackedPose {
    /// Camera centre, world units; the origin for the first frame.
    pub centre: [f64; 3],
    /// Rotation from the camera's OpenCV axes to the world's: unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Standard deviation of the rotation about the least certain axis, radians.
    pub turn_deviation: f64,
    /// Standard deviation of the centre along the least certain axis, world units.
    pub shift_deviation: f64,
    /// Share of the frame covered by the scene from that pose, 0 to 1.
    pub overlap: f64,
    /// Agreement of depth and colour at that pose, 0 to 1.
    pub agreement: f64,
}

impl TrackedPose {
    /// Creates the pose of the first frame, which defines the world.
    pub fn first(pose: &Pose) -> Self {
        Self::new(pose, [0.0; 2], 1.0, 1.0)
    }

    /// Creates a pose with the standard deviations of its rotation (radians) and centre (world units).
    pub fn new(pose: &Pose, deviations: [f64; 2], overlap: f64, agreement: f64) -> Self {
        let [turn_deviation, shift_deviation] = deviations;
        let rotation = DQuat::from_mat3(&pose.rotation()).normalize().to_array();
        let centre = pose.centre().to_array();
        Self { centre, rotation, turn_deviation, shift_deviation, overlap, agreement }
    }

    /// Returns the pose; `None` if the numbers do not form one.
    pub fn pose(&self) -> Option<Pose> {
        let rotation = unit_rotation(self.rotation)?;
        let matrix = DMat4::from_rotation_translation(rotation, DVec3::from_array(self.centre));
        Pose::from_opencv(matrix).ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn poses_are_read_back() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        let tracked = TrackedPose::new(&pose, [0.001, 0.002], 0.9, 0.8);
        let apart = tracked.pose().unwrap().to_opencv() - pose.to_opencv();
        assert!(apart.to_cols_array().iter().all(|x| x.abs() < 1e-12));
        let nonsense = TrackedPose { rotation: [f64::NAN, 0.0, 0.0, 1.0], ..tracked };
        assert_eq!(nonsense.pose(), None);
    }
}
