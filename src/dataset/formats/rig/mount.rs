//! How a camera sits on what its trajectory follows: markers of a motion capture are not its lens.

use crate::math::pose::Pose;
use glam::{DQuat, DVec3};

/// Where a camera sits on what its trajectory follows.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(in super::super) struct Mount {
    /// In the axes of what is followed, which are about the camera's: metres.
    pub shift: DVec3,
    /// Axis times angle, radians.
    pub turn: DVec3,
}

impl Mount {
    /// The pose of the camera where what is followed has this one.
    pub fn of(&self, followed: &Pose) -> Pose {
        followed.attached(self.shift, DQuat::from_scaled_axis(self.turn))
    }
}
