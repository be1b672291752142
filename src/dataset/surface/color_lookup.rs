//! Colours of points: their own pixel's, or what a colour camera of its own saw there.

use super::occluders::Occluders;
use super::planes::Planes;
use super::projection::Projection;
use crate::dataset::calibration::Calibration;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::observation::surface::DepthTolerance;
use glam::{Vec2, Vec3};

/// Colours of one frame's points.
pub(super) struct ColorLookup<'a> {
    image: &'a Image<[u8; 4]>,
    beside: Option<Beside<'a>>,
    /// Of every byte.
    channel: [f32; 256],
    gain: Vec3,
}

/// A colour camera that stands beside the depth camera.
struct Beside<'a> {
    camera: Projection,
    occluders: &'a Occluders,
    margin: [f32; 2],
}

impl<'a> ColorLookup<'a> {
    /// `occluders` are filled with the frame if its colours are not registered.
    pub fn new(
        frame: &'a Frame,
        planes: &Planes,
        calibration: &Calibration,
        tolerance: &DepthTolerance,
        occluders: &'a mut Occluders,
    ) -> Self {
        let gain = Vec3::from_array(calibration.gain(&frame.name).map(|g| g as f32));
        let image = &frame.color;
        let color_camera = frame.photographed_by(calibration.color_camera.as_ref());
        let beside = color_camera.map(|camera| {
            let camera = Projection::new(&camera);
            occluders.fill(planes, [image.width, image.height], &camera);
            Beside { camera, occluders, margin: tolerance.margin }
        });
        // A table instead of up to twelve divisions a point.
        let channel = std::array::from_fn(|byte| byte as f32 / 255.0);
        Self { image, beside, channel, gain }
    }

    /// Colour of a pixel of the depth image, whose point in the depth camera's frame is given;
    /// `None` where the colour camera does not see it.
    #[inline(always)]
    pub fn color(&self, pixel: usize, point: Vec3) -> Option<[f32; 3]> {
        let color = match &self.beside {
            None => self.texel(pixel),
            Some(Beside { camera, occluders, margin: [constant, linear] }) => {
                let point = camera.turned(point);
                if occluders.hide(camera, point, constant + linear * point.z) {
                    return None;
                }
                self.bilinear(camera.project(point)?)?
            }
        };
        // Clamped as a camera clips; a colour above 1 would be none.
        Some((color * self.gain).min(Vec3::ONE).to_array())
    }

    #[inline(always)]
    fn texel(&self, pixel: usize) -> Vec3 {
        let [r, g, b, _] = self.image.data[pixel].map(|byte| self.channel[usize::from(byte)]);
        Vec3::new(r, g, b)
    }

    #[inline(always)]
    fn bilinear(&self, at: Vec2) -> Option<Vec3> {
        let Image { width, height, .. } = self.image;
        let corner = at - 0.5;
        let last = Vec2::new(*width as f32 - 1.0, *height as f32 - 1.0);
        // Negated, so that NaN is outside.
        if !(corner.cmpge(Vec2::ZERO).all() && corner.cmple(last).all()) {
            return None;
        }
        let (x, y) = (corner.x as usize, corner.y as usize);
        let t = corner - Vec2::new(x as f32, y as f32);
        // At the last column and row the neighbour weighs nothing, but must exist.
        let right = usize::from(x + 1 < *width);
        let below = if y + 1 < *height { *width } else { 0 };
        let i = y * width + x;
        let above = mix(self.texel(i), self.texel(i + right), t.x);
        let under = mix(self.texel(i + below), self.texel(i + below + right), t.x);
        Some(mix(above, under, t.y))
    }
}

#[inline(always)]
fn mix(from: Vec3, to: Vec3, t: f32) -> Vec3 {
    from + (to - from) * t
}
