//! Projection into a separate colour camera in f32, for colour lookup and for occlusion tests.

use crate::dataset::calibration::ColorCamera;
use crate::math::simd::{Vector, turned};

/// A colour camera in f32.
pub(super) struct Projection {
    /// Rotation from the depth camera's axes to the colour camera's, by rows.
    turn: [[f32; 3]; 3],
    offset: [f32; 3],
    focal: [f32; 2],
    principal: [f32; 2],
}

impl Projection {
    pub fn new(camera: &ColorCamera) -> Self {
        Self {
            turn: camera.color_from_depth().transpose().to_cols_array_2d().map(single),
            offset: single(camera.offset),
            focal: single(camera.focal),
            principal: single(camera.principal),
        }
    }

    /// Transforms points from the depth camera's frame to the colour camera's.
    #[inline(always)]
    pub fn turned_lanes<V: Vector>(&self, [x, y, z]: [V; 3]) -> [V; 3] {
        let [right, down, ahead] = self.offset;
        turned(&self.turn, [x - V::splat(right), y - V::splat(down), z - V::splat(ahead)])
    }

    /// Pixel coordinates of points in the colour camera's frame; undefined behind the camera.
    #[inline(always)]
    pub fn project_lanes<V: Vector>(&self, [x, y, z]: [V; 3]) -> [V; 2] {
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        [V::splat(fx) * x / z + V::splat(cx), V::splat(fy) * y / z + V::splat(cy)]
    }
}

fn single<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}
