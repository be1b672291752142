//! Photograph of a frame, which training compares with rendered images.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// Photograph of a frame with its camera.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Pinhole intrinsics of the colour camera.
    pub intrinsics: Intrinsics,
    /// Position of the colour camera in the depth camera's frame, world units.
    pub offset: DVec3,
    /// Rotation of the colour camera relative to the depth camera.
    pub rotation: DQuat,
    /// Red, green, blue and opacity in 255ths, sRGB-encoded.
    pub colors: Arc<Image<[u8; 4]>>,
    /// Calibrated gains of red, green and blue.
    pub gain: [f32; 3],
    /// Depth of the surface in each pixel along this camera's optical axis, world units; 0 if unknown.
    pub depths: Image<f32>,
    /// True if opacities and depths indicate how much of a pixel surfaces cover.
    pub has_coverage: bool,
}

impl Photograph {
    /// Colour camera for a given pose of the depth camera.
    pub fn camera(&self, depth: &Pose) -> Camera {
        Camera {
            intrinsics: self.intrinsics,
            pose: depth.attached_camera(self.offset, self.rotation),
        }
    }

    /// Measured pixels of one row in order, with the photograph's gain. A surface within `margin[0] +
    /// margin[1]·depth` (world units) of the depth counts as the measured one.
    pub fn measured_row(
        &self,
        row: usize,
        margin: [f32; 2],
    ) -> impl ExactSizeIterator<Item = MeasuredPixel> + '_ {
        let width = self.colors.width;
        let depths = &self.depths.data[row * width..][..width];
        let colors = &self.colors.data[row * width..][..width];
        colors.iter().zip(depths).map(move |(color, depth)| {
            let [red, green, blue, alpha] = color.map(|byte| f32::from(byte) / 255.0);
            let covered = match self.has_coverage {
                true if color[3] < u8::MAX => alpha,
                true if *depth > 0.0 => 1.0,
                _ => f32::NAN,
            };
            let [r, g, b] = [red, green, blue].map(|channel| channel * alpha);
            let [r, g, b] = [r * self.gain[0], g * self.gain[1], b * self.gain[2]];
            MeasuredPixel::without_depth([r, g, b, covered]).with_depth(*depth, margin)
        })
    }

    /// Measured pixels of the whole photograph, with an additional gain on red, green and blue.
    pub fn measured_pixels(&self, gain: [f32; 3], margin: [f32; 2]) -> Image<MeasuredPixel> {
        let exposed = |pixel: MeasuredPixel| {
            let [r, g, b] = pixel.color;
            MeasuredPixel { color: [r * gain[0], g * gain[1], b * gain[2]], ..pixel }
        };
        let Image { width, height, .. } = *self.colors;
        let pixels =
            (0..height).flat_map(|row| self.measured_row(row, margin)).map(exposed).collect();
        Image::from_vec(width, height, pixels)
    }
}
