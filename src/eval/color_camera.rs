//! Photographs taken by another camera than depth (`accuracy.md` 7).

use crate::math::camera::{Camera, Intrinsics};
use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// A pinhole camera fixed to the depth camera, with images of the same size.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct ColorCamera {
    /// Focal lengths, pixels.
    pub focal: [f64; 2],
    /// Principal point, pixels.
    pub principal: [f64; 2],
    /// Where it stands in the depth camera's frame, world units.
    pub offset: [f64; 3],
    /// Axis times angle in radians of the rotation that takes its axes to the depth camera's.
    pub rotation: [f64; 3],
}

/// The camera that took a frame's photograph, from the one that measured its depth.
pub fn beside(depth: &Camera, color: &ColorCamera) -> Camera {
    let ([fx, fy], [cx, cy]) = (color.focal, color.principal);
    let turn = DQuat::from_scaled_axis(DVec3::from_array(color.rotation));
    Camera {
        intrinsics: Intrinsics { fx, fy, cx, cy, ..depth.intrinsics },
        pose: depth.pose.attached(DVec3::from_array(color.offset), turn),
    }
}
