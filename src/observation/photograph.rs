//! The picture that a frame's camera took, as learning compares it with what a scene shows.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};

/// A frame's photograph and where it was taken from.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Pinhole of the camera that took it.
    pub intrinsics: Intrinsics,
    /// Where that camera stands in the frame of the depth camera, world units.
    pub offset: DVec3,
    /// How its axes are turned against those of the depth camera.
    pub turn: DQuat,
    /// What was measured of its pixels.
    pub pixels: Image<MeasuredPixel>,
}

impl Photograph {
    /// The camera that took it, where the depth camera has this pose.
    pub fn camera(&self, depth: &Pose) -> Camera {
        Camera { intrinsics: self.intrinsics, pose: depth.attached(self.offset, self.turn) }
    }

    /// The pixels with a gain on red, green and blue; `None` if that changes nothing.
    pub fn exposed(&self, gain: [f32; 3]) -> Option<Image<MeasuredPixel>> {
        let Image { width, height, data } = &self.pixels;
        let exposed = |pixel: &MeasuredPixel| {
            let [r, g, b] = pixel.color;
            MeasuredPixel { color: [r * gain[0], g * gain[1], b * gain[2]], ..*pixel }
        };
        (gain != [1.0; 3])
            .then(|| Image::from_vec(*width, *height, data.iter().map(exposed).collect()))
    }
}
