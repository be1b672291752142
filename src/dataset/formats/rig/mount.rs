//! Mount of a camera on the tracked body, such as the markers of motion capture.

use crate::math::pose::Pose;
use glam::{DQuat, DVec3};

/// Pose of a camera relative to the tracked body.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in super::super) struct Mount {
    /// Translation in the body's axes, which are close to the camera's; metres.
    pub shift: DVec3,
    /// Rotation vector, radians.
    pub turn: DVec3,
}

impl Mount {
    /// Camera pose for a pose of the tracked body.
    pub fn camera_pose(&self, followed: &Pose) -> Pose {
        followed.attached_camera(self.shift, DQuat::from_scaled_axis(self.turn))
    }
}
