//! A colour camera that stands beside the depth camera, in f32: what looks colours up and what finds
//! hidden surfaces both project by it.

use crate::dataset::calibration::ColorCamera;
use glam::{Mat3, Vec2, Vec3};

/// A colour camera in f32.
pub(super) struct Projection {
    turn: Mat3,
    offset: Vec3,
    focal: Vec2,
    principal: Vec2,
}

impl Projection {
    pub fn new(camera: &ColorCamera) -> Self {
        Self {
            turn: camera.color_from_depth().as_mat3(),
            offset: Vec3::from_array(camera.offset.map(|v| v as f32)),
            focal: Vec2::from_array(camera.focal.map(|v| v as f32)),
            principal: Vec2::from_array(camera.principal.map(|v| v as f32)),
        }
    }

    /// A point of the depth camera's frame in the colour camera's.
    #[inline(always)]
    pub fn turned(&self, point: Vec3) -> Vec3 {
        self.turn * (point - self.offset)
    }

    /// Pixel coordinates of a point of the colour camera's frame; `None` behind the camera.
    #[inline(always)]
    pub fn project(&self, point: Vec3) -> Option<Vec2> {
        (point.z > 0.0).then(|| self.focal * point.truncate() / point.z + self.principal)
    }
}
