//! Depth of one frame: the stored values and their conversion to lengths.
//!
//! Depth is retained as the file stores it, for three reasons. The edge filter of the published
//! algorithm is defined on 8-bit codes, the plane fit uses a table of all codes, and a sensor's noise
//! follows from its code step. Depth from memory has no codes and is stored as lengths.

use super::distortion::Distortion;
use super::error::FrameProblem;
use super::frame::length_per_z;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;

/// Distance at code 0 in the 8-bit depth of NeRF-synthetic scenes, world units. Code `d` encodes the
/// distance `ℓ = 8·(1 − d/255)`.
pub const INVERSE8_RANGE: f64 = 8.0;

/// Largest 16-bit depth code; it marks a hole (a pixel without depth), as code 0 does.
pub const HOLE16: u16 = u16::MAX;

/// Direction along which a depth value is measured.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthKind {
    /// Distance from the camera's centre along the pixel's ray.
    RayDistance,
    /// Distance along the optical axis.
    Z,
}

/// Depth values as stored in the file, with their conversion to lengths. The edge filter (`dataset.md`,
/// Edge filter) is defined on stored values.
#[derive(Clone, Debug, PartialEq)]
pub enum DepthCodes {
    /// 8-bit codes `d` for lengths of `8·(1 − d/255)` world units. Code 0 is background, code 255 is
    /// invalid.
    Inverse8(Image<u8>),
    /// 16-bit codes `d` for lengths of `d · unit` world units. Codes 0 and 65535 are holes (pixels
    /// without depth).
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
    /// Direction along which depth is measured.
    pub kind: DepthKind,
    /// Open interval of the lengths that training uses, world units, measured along `kind`. Lengths
    /// outside are unreliable.
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
    /// Returns width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        self.codes.size()
    }

    /// Returns the length at a pixel, world units; `None` at a hole. Includes lengths outside the
    /// trusted interval.
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

    /// Returns depth along the optical axis at pixels with trusted depth, world units; 0 at other
    /// pixels. `k` holds the intrinsics of the depth camera.
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
                    // Codes of holes are not lengths.
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

/// Converts an 8-bit code to a length, world units. Returns `None` for 0 (background) and for 255 (the
/// camera's centre).
pub(super) fn decode_inverse8(code: u8) -> Option<f64> {
    (1..255).contains(&code).then(|| INVERSE8_RANGE * (1.0 - f64::from(code) / 255.0))
}

/// Converts a 16-bit code to a length, given `unit` world units per code step. Returns `None` for the
/// holes 0 and [`HOLE16`].
pub(super) fn decode_linear16(code: u16, unit: f64) -> Option<f64> {
    (code != 0 && code != HOLE16).then(|| f64::from(code) * unit)
}

/// Converts a stored float to a length; `None` for a hole. Drivers mark holes by 0, NaN, infinity or a
/// negative number.
pub(super) fn decode_length(length: f32) -> Option<f64> {
    (length.is_finite() && length > 0.0).then(|| f64::from(length))
}

/// Half-width of the depth noise of a metric depth camera at distances up to 1 m, metres. Beyond 1 m, it
/// grows with the square of the distance (`dataset.md`, Sensors).
pub(super) const SENSOR_NOISE: f64 = 0.003;

/// Returns the half-width of the depth noise of a metric depth camera, metres, at a depth of `value`
/// metres.
#[inline(always)]
pub(super) fn sensor_noise(value: f32) -> f32 {
    SENSOR_NOISE as f32 * (value * value).max(1.0)
}
