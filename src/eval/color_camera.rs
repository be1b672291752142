//! Photographs taken by another camera than depth (`accuracy.md` 7).

pub use crate::dataset::calibration::ColorCamera;

use crate::math::camera::{Camera, Intrinsics};
use glam::{DQuat, DVec3};

/// The camera that took a frame's photograph, from the one that measured its depth.
pub fn beside(depth: &Camera, color: &ColorCamera) -> Camera {
    let ([fx, fy], [cx, cy]) = (color.focal, color.principal);
    let turn = DQuat::from_scaled_axis(DVec3::from_array(color.rotation));
    Camera {
        intrinsics: Intrinsics { fx, fy, cx, cy, ..depth.intrinsics },
        pose: depth.pose.attached(DVec3::from_array(color.offset), turn),
    }
}
