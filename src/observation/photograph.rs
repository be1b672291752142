//! The picture that a frame's camera took, as learning compares it with what a scene shows.

use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// A frame's photograph and where it was taken from.
#[derive(Clone, Debug)]
pub struct Photograph {
    /// Pinhole of the camera that took it.
    pub intrinsics: Intrinsics,
    /// Where that camera stands in the frame of the depth camera, world units.
    pub offset: DVec3,
    /// How its axes are turned against those of the depth camera.
    pub turn: DQuat,
    /// Red, green, blue and opacity of its pixels, sRGB-encoded, in 255ths.
    pub colors: Arc<Image<[u8; 4]>>,
    /// Factors that a calibration puts on red, green and blue.
    pub gain: [f32; 3],
    /// Depth of the surface in every pixel along this camera's axis, world units; 0 where it is not known.
    pub depths: Image<f32>,
    /// Whether opacities and depths say how much of a pixel surfaces cover.
    pub shows_coverage: bool,
}

impl Photograph {
    /// The camera that took it, where the depth camera has this pose.
    pub fn camera(&self, depth: &Pose) -> Camera {
        Camera { intrinsics: self.intrinsics, pose: depth.attached(self.offset, self.turn) }
    }

    /// What was measured of a row of its pixels, in order, with its own gain; surfaces within `margin[0] +
    /// margin[1]·depth` of a depth are the measured one, world units.
    pub fn row(
        &self,
        row: usize,
        margin: [f32; 2],
    ) -> impl ExactSizeIterator<Item = MeasuredPixel> + '_ {
        let width = self.colors.width;
        let depths = &self.depths.data[row * width..][..width];
        let colors = &self.colors.data[row * width..][..width];
        colors.iter().zip(depths).map(move |(color, depth)| {
            let [red, green, blue, alpha] = color.map(|byte| f32::from(byte) / 255.0);
            let covered = match self.shows_coverage {
                true if color[3] < u8::MAX => alpha,
                true if *depth > 0.0 => 1.0,
                _ => f32::NAN,
            };
            let [r, g, b] = [red, green, blue].map(|channel| channel * alpha);
            let [r, g, b] = [r * self.gain[0], g * self.gain[1], b * self.gain[2]];
            MeasuredPixel::flat([r, g, b, covered]).at_depth(*depth, margin)
        })
    }

    /// What was measured of all its pixels, with a gain on red, green and blue beside its own.
    pub fn exposed(&self, gain: [f32; 3], margin: [f32; 2]) -> Image<MeasuredPixel> {
        let exposed = |pixel: MeasuredPixel| {
            let [r, g, b] = pixel.color;
            MeasuredPixel { color: [r * gain[0], g * gain[1], b * gain[2]], ..pixel }
        };
        let Image { width, height, .. } = *self.colors;
        let pixels = (0..height).flat_map(|row| self.row(row, margin)).map(exposed).collect();
        Image::from_vec(width, height, pixels)
    }
}
