//! One frame in memory: camera, colour and depth, already checked.

use super::error::{FrameError, FrameProblem};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;

/// Distance of code 0 in the classic 8-bit export, world units: `ℓ = 8·(1 − d/255)`.
pub const INVERSE8_RANGE: f64 = 8.0;

/// Largest 16-bit code: a hole, as 0 is.
pub const HOLE16: u16 = u16::MAX;

/// A frame whose parts agree: colour and depth have the camera's size, the pose is rigid.
#[derive(Clone, Debug)]
pub struct Frame {
    /// Name within the split.
    pub name: String,
    /// Intrinsics and pose.
    pub camera: Camera,
    /// sRGB-encoded straight (not premultiplied) RGBA bytes; alpha is 255 where the file has none.
    pub color: Image<[u8; 4]>,
    /// Depth, in splits that have it.
    pub depth: Option<Depth>,
}

/// What a depth value measures.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Distance from the camera's centre along the pixel's ray.
    RayDistance,
    /// Distance along the optical axis.
    Z,
}

/// Depth codes as stored, with the rule that makes lengths of them. Codes are kept because the
/// edge filter (`dataset.md`, Edge filter) is defined on them.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthCodes {
    /// `8·(1 − d/255)` world units, `d = 0` is no surface.
    Inverse8(Image<u8>),
    /// `d · unit` world units, `d = 0` and `d = 65535` are holes.
    Linear16 {
        /// The stored values.
        codes: Image<u16>,
        /// World units per code step, positive.
        unit: f64,
    },
}

/// Depth image of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// The stored values.
    pub codes: DepthCodes,
    /// What they measure.
    pub kind: DepthKind,
    /// Open interval of lengths (of `kind`, world units) that training uses; values outside are
    /// measured but unreliable.
    pub trusted: [f64; 2],
}

impl Depth {
    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        match &self.codes {
            DepthCodes::Inverse8(codes) => (codes.width, codes.height),
            DepthCodes::Linear16 { codes, .. } => (codes.width, codes.height),
        }
    }

    /// Length at a pixel in world units, `None` at a hole; the trusted interval is not applied.
    pub fn value_at(&self, column: usize, row: usize) -> Option<f64> {
        match &self.codes {
            DepthCodes::Inverse8(codes) => decode_inverse8(*codes.at(column, row)),
            DepthCodes::Linear16 { codes, unit } => decode_linear16(*codes.at(column, row), *unit),
        }
    }

    /// Whether a length lies in the trusted interval.
    pub fn trusts(&self, value: f64) -> bool {
        value > self.trusted[0] && value < self.trusted[1]
    }

    /// Whether there is no surface in the whole image.
    pub(super) fn is_empty(&self) -> bool {
        match &self.codes {
            DepthCodes::Inverse8(codes) => codes.data.iter().all(|d| *d == 0),
            DepthCodes::Linear16 { codes, .. } => {
                codes.data.iter().all(|d| *d == 0 || *d == HOLE16)
            }
        }
    }
}

impl Frame {
    /// Its depth, where points are to be made of it.
    pub(super) fn depth_to_use(&self) -> Result<&Depth, FrameError> {
        self.depth.as_ref().ok_or_else(|| FrameError {
            file: self.name.clone().into(),
            frame: self.name.clone(),
            problem: FrameProblem::NoDepth,
        })
    }

    /// Depth along the optical axis in world units, 0 at holes, for evaluation and plane fits;
    /// `None` in frames without depth. The trusted interval is not applied.
    pub fn depth_z(&self) -> Option<Image<f32>> {
        self.depth_as(DepthKind::Z)
    }

    /// Depth measured as asked, whatever the file holds; otherwise as [`Self::depth_z`].
    pub fn depth_as(&self, kind: DepthKind) -> Option<Image<f32>> {
        let depth = self.depth.as_ref()?;
        let (width, height) = depth.size();
        let mut out = Image::filled(width, height, 0.0);
        for row in 0..height {
            for column in 0..width {
                if let Some(value) = depth.value_at(column, row) {
                    let per_z = |kind| length_per_z(&self.camera.intrinsics, kind, column, row);
                    let length = value / per_z(depth.kind) * per_z(kind);
                    out.data[row * width + column] = length as f32;
                }
            }
        }
        Some(out)
    }
}

/// How much longer a length of `kind` is than the depth z at a pixel (1 for z itself).
fn length_per_z(k: &Intrinsics, kind: DepthKind, column: usize, row: usize) -> f64 {
    match kind {
        DepthKind::RayDistance => k.ray(column, row).length(),
        DepthKind::Z => 1.0,
    }
}

/// Length of an 8-bit code; code 255 is the camera's centre, which no surface can be at.
pub(super) fn decode_inverse8(code: u8) -> Option<f64> {
    (1..255).contains(&code).then(|| INVERSE8_RANGE * (1.0 - f64::from(code) / 255.0))
}

/// Length of a 16-bit code.
pub(super) fn decode_linear16(code: u16, unit: f64) -> Option<f64> {
    (code != 0 && code != HOLE16).then(|| f64::from(code) * unit)
}

/// Noise half-width of a metric depth camera up to 1 m, metres; beyond it grows with the square of
/// the distance (`dataset.md`, Sensors).
pub(super) const SENSOR_NOISE: f64 = 0.003;

/// Noise half-width of a metric depth camera, metres.
#[inline]
pub(super) fn sensor_noise(value: f32) -> f32 {
    SENSOR_NOISE as f32 * (value * value).max(1.0)
}
