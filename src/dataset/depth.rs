//! Depth of one frame: the stored values and their conversion to lengths.
//!
//! Depth is retained as the file stores it. The edge filter of the published algorithm is defined on 8-bit
//! codes, the plane fit uses a table of all codes, and a sensor's noise follows from its code step. Depth
//! that was never a file has no codes and is stored as lengths.

use super::distortion::Distortion;
use super::error::FrameProblem;
use super::frame::length_per_z;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;

/// Distance of code 0 in the classic 8-bit export, world units: `ℓ = 8·(1 − d/255)`.
pub const INVERSE8_RANGE: f64 = 8.0;

/// Largest 16-bit code: a hole, as 0 is.
pub const HOLE16: u16 = u16::MAX;

/// Direction along which a depth value is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Distance from the camera's centre along the pixel's ray.
    RayDistance,
    /// Distance along the optical axis.
    Z,
}

/// Depth codes as stored, with their conversion to lengths. The edge filter (`dataset.md`, Edge filter) is
/// defined on codes.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthCodes {
    /// `8·(1 − d/255)` world units; `d = 0` is background, `d = 255` invalid.
    Inverse8(Image<u8>),
    /// `d · unit` world units; `d = 0` and `d = 65535` are holes.
    Linear16 {
        /// The stored values.
        codes: Image<u16>,
        /// World units per code step, positive.
        unit: f64,
    },
    /// Lengths in world units; values that are not finite and positive are holes.
    Lengths(Image<f32>),
}

/// Depth image of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Depth {
    /// The stored values.
    pub codes: DepthCodes,
    /// Direction of measurement.
    pub kind: DepthKind,
    /// Open interval of lengths (as `kind` measures, world units) that training uses; values outside are
    /// unreliable.
    pub trusted: [f64; 2],
    /// World units per metre; converts sensor properties that are known in metres.
    pub units_per_metre: f64,
}

impl DepthCodes {
    pub(super) fn size(&self) -> (usize, usize) {
        match self {
            Self::Inverse8(codes) => (codes.width, codes.height),
            Self::Linear16 { codes, .. } => (codes.width, codes.height),
            Self::Lengths(lengths) => (lengths.width, lengths.height),
        }
    }
}

impl Depth {
    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.codes.size()
    }

    /// Length at a pixel in world units, `None` at a hole; ignores the trusted interval.
    pub fn value_at(&self, column: usize, row: usize) -> Option<f64> {
        match &self.codes {
            DepthCodes::Inverse8(codes) => decode_inverse8(*codes.at(column, row)),
            DepthCodes::Linear16 { codes, unit } => decode_linear16(*codes.at(column, row), *unit),
            DepthCodes::Lengths(lengths) => decode_length(*lengths.at(column, row)),
        }
    }

    /// True if a length is in the trusted interval.
    pub fn is_trusted(&self, value: f64) -> bool {
        value > self.trusted[0] && value < self.trusted[1]
    }

    /// Depth along the optical axis of trusted pixels, world units; 0 elsewhere. `k` is the depth camera.
    pub(crate) fn trusted_z(&self, k: &Intrinsics) -> Image<f64> {
        let (width, height) = self.size();
        let mut out = Image::filled(width, height, 0.0);
        for (i, z) in out.data.iter_mut().enumerate() {
            let (column, row) = (i % width, i / width);
            if let Some(value) = self.value_at(column, row).filter(|value| self.is_trusted(*value))
            {
                *z = value / length_per_z(k, self.kind, column, row);
            }
        }
        out
    }

    pub(super) fn check(&self, camera: (u32, u32)) -> Result<(), FrameProblem> {
        let (width, height) = self.size();
        let depth = (width as u32, height as u32);
        if depth != camera {
            return Err(FrameProblem::Size { what: "depth", expected: camera, found: depth });
        }
        if self.is_empty() {
            return Err(FrameProblem::NoDepthValues);
        }
        Ok(())
    }

    pub(super) fn make_holes(&mut self, is_hole: impl Fn(usize) -> bool) {
        fn punched<T: Copy>(data: &mut [T], hole: T, is_hole: impl Fn(usize) -> bool) {
            data.iter_mut().enumerate().filter(|(i, _)| is_hole(*i)).for_each(|(_, v)| *v = hole);
        }
        match &mut self.codes {
            DepthCodes::Inverse8(codes) => punched(&mut codes.data, 0, is_hole),
            DepthCodes::Linear16 { codes, .. } => punched(&mut codes.data, 0, is_hole),
            DepthCodes::Lengths(lengths) => punched(&mut lengths.data, 0.0, is_hole),
        }
    }

    pub(super) fn undistort(&mut self, lens: &Distortion, k: &Intrinsics) {
        fn replace<T>(image: &mut Image<T>, new: impl Fn(&Image<T>) -> Option<Image<T>>) {
            if let Some(new) = new(image) {
                *image = new;
            }
        }
        let scaled = |factor: f64| if self.kind == DepthKind::Z { factor } else { 1.0 };
        match &mut self.codes {
            DepthCodes::Inverse8(codes) => {
                // Ray distances do not change when the camera rotates.
                replace(codes, |codes| lens.undistort_depth(k, codes, 0, |code, _| code));
            }
            DepthCodes::Linear16 { codes, .. } => {
                let along_axis = |code: u16, factor| match code {
                    // Codes of holes are no lengths.
                    0 | HOLE16 => code,
                    // Factors are near 1; the saturating cast makes a length beyond the last code a hole.
                    code => (f64::from(code) * scaled(factor)).round() as u16,
                };
                replace(codes, |codes| lens.undistort_depth(k, codes, 0, along_axis));
            }
            DepthCodes::Lengths(lengths) => {
                let along_axis = |length, factor| length * scaled(factor) as f32;
                replace(lengths, |lengths| lens.undistort_depth(k, lengths, 0.0, along_axis));
            }
        }
    }

    fn is_empty(&self) -> bool {
        let (width, height) = self.size();
        (0..height).all(|row| (0..width).all(|column| self.value_at(column, row).is_none()))
    }
}

/// Length of an 8-bit code; code 255 is the camera centre, where no surface can be.
pub(super) fn decode_inverse8(code: u8) -> Option<f64> {
    (1..255).contains(&code).then(|| INVERSE8_RANGE * (1.0 - f64::from(code) / 255.0))
}

/// Length of a 16-bit code with `unit` world units per step; 0 and [`HOLE16`] are holes.
pub(super) fn decode_linear16(code: u16, unit: f64) -> Option<f64> {
    (code != 0 && code != HOLE16).then(|| f64::from(code) * unit)
}

/// Length of a stored float. Drivers mark a missing return by 0, NaN, infinity or a negative number.
pub(super) fn decode_length(length: f32) -> Option<f64> {
    (length.is_finite() && length > 0.0).then(|| f64::from(length))
}

/// Noise half-width of a metric depth camera up to 1 m, metres; beyond it grows with the square of
/// the distance (`dataset.md`, Sensors).
pub(super) const SENSOR_NOISE: f64 = 0.003;

/// Noise half-width of a metric depth camera at a depth of `value` metres, in metres.
#[inline(always)]
pub(super) fn sensor_noise(value: f32) -> f32 {
    SENSOR_NOISE as f32 * (value * value).max(1.0)
}
