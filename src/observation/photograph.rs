//! The picture that a frame's camera took, as learning compares it with what a scene shows.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
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
    /// sRGB-encoded red, green and blue over black in `[0, 1]`, and how much of the pixel surfaces
    /// cover: NaN where that is not known.
    pub pixels: Image<[f32; 4]>,
}

impl Photograph {
    /// The camera that took it, where the depth camera has this pose.
    pub fn camera(&self, depth: &Pose) -> Camera {
        Camera { intrinsics: self.intrinsics, pose: depth.attached(self.offset, self.turn) }
    }

    /// The pixels with a gain on red, green and blue; `None` if that changes nothing.
    pub fn exposed(&self, gain: [f32; 3]) -> Option<Image<[f32; 4]>> {
        let Image { width, height, data } = &self.pixels;
        let exposed =
            |&[r, g, b, covered]: &[f32; 4]| [r * gain[0], g * gain[1], b * gain[2], covered];
        (gain != [1.0; 3])
            .then(|| Image::from_vec(*width, *height, data.iter().map(exposed).collect()))
    }
}
