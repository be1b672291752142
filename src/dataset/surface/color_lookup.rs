//! Colours of points: from the same pixel, or from a separate colour camera.

use super::seen::{Projection, ReprojectedDepths};
use crate::dataset::calibration::Calibration;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::math::measured_pixel::MASKED;
use crate::math::simd::{LANES, Vector};
use glam::{Vec2, Vec3};

pub(super) struct ColorLookup<'a> {
    image: &'a Image<[u8; 4]>,
    beside: Option<Beside<'a>>,
    channel: [f32; 256],
    gain: Vec3,
}

/// Colour camera separate from the depth camera, and the depths that it sees.
pub(super) struct Beside<'a> {
    pub camera: &'a Projection,
    pub depths: &'a ReprojectedDepths,
    /// Maximum depth difference within one surface, as a function of depth: constant (world units) and
    /// linear coefficient.
    pub margin: [f32; 2],
}

/// Projection of eight points into the separate colour camera; unused if there is none.
#[derive(Default)]
pub(super) struct SeenLanes {
    at: [[f32; LANES]; 2],
    /// Depth of each point along the colour camera's axis, world units. A point is hidden if it is more
    /// than `margin` behind the nearest surface.
    depth: [f32; LANES],
    margin: [f32; LANES],
}

impl<'a> ColorLookup<'a> {
    pub fn new(frame: &'a Frame, calibration: &Calibration, beside: Option<Beside<'a>>) -> Self {
        let gain = Vec3::from_array(calibration.gain(&frame.name).map(|g| g as f32));
        // A table instead of up to twelve divisions per point.
        let channel = std::array::from_fn(|byte| byte as f32 / 255.0);
        Self { image: &frame.color, beside, channel, gain }
    }

    #[inline(always)]
    pub fn seen_lanes<V: Vector>(&self, points: [V; 3]) -> SeenLanes {
        let Some(Beside { camera, margin, .. }) = &self.beside else { return SeenLanes::default() };
        let points = camera.turned_lanes(points);
        let [u, v] = camera.project_lanes(points);
        let [constant, linear] = *margin;
        SeenLanes {
            at: [u.to_array(), v.to_array()],
            depth: points[2].to_array(),
            margin: (V::splat(constant) + V::splat(linear) * points[2]).to_array(),
        }
    }

    /// Returns the colour of the point in lane `lane` of eight, at `pixel` of the depth image. Returns
    /// `None` if the point is hidden from the colour camera, or its colour is left out.
    #[inline(always)]
    pub fn color(&self, pixel: usize, seen: &SeenLanes, lane: usize) -> Option<[f32; 3]> {
        let color = match &self.beside {
            None => self.texel(pixel)?,
            Some(Beside { depths, .. }) => {
                let (at, depth) = ([seen.at[0][lane], seen.at[1][lane]], seen.depth[lane]);
                // Behind the camera, the projection is meaningless.
                if depth <= 0.0 || depths.occludes(at, depth, seen.margin[lane]) {
                    return None;
                }
                self.bilinear(Vec2::from_array(at))?
            }
        };
        // Clamped like a saturated camera; colours are at most 1.
        Some((color * self.gain).min(Vec3::ONE).to_array())
    }

    #[inline(always)]
    fn texel(&self, pixel: usize) -> Option<Vec3> {
        let color = self.image.data[pixel];
        let [r, g, b] = [0, 1, 2].map(|i| self.channel[usize::from(color[i])]);
        (color != MASKED).then_some(Vec3::new(r, g, b))
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
        // At the last column and row the neighbour's weight is 0, but its index must be valid.
        let right = usize::from(x + 1 < *width);
        let below = if y + 1 < *height { *width } else { 0 };
        let i = y * width + x;
        let above = mix(self.texel(i)?, self.texel(i + right)?, t.x);
        let under = mix(self.texel(i + below)?, self.texel(i + below + right)?, t.x);
        Some(mix(above, under, t.y))
    }
}

#[inline(always)]
fn mix(from: Vec3, to: Vec3, t: f32) -> Vec3 {
    from + (to - from) * t
}
