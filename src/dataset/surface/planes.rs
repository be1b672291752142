//! Decodes depth codes to f32 planes for the fit: depth, its inverse and its noise, with an empty border so
//! that no window leaves them.
//!
//! The length of a code depends on file, trusted interval and calibration, but not on the pixel. So a table
//! of all codes is built once and reused between frames. Lengths from memory have no codes and are
//! converted individually. Planes are separate arrays instead of structs per pixel, because the fit loads
//! eight neighbouring values of one kind at a time.

use super::emit::PixelStatus;
use super::sensor::{NoiseLaw, Profile};
use super::settings::{LENGTHS, RADIUS};
use crate::dataset::calibration::Calibration;
use crate::dataset::depth::{
    Depth, DepthCodes, DepthKind, decode_inverse8, decode_length, decode_linear16,
};
use crate::dataset::frame::Frame;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::simd::{Kernel, LANES, Vector};
use std::ops::Range;

/// Depth value of unusable pixels; larger than any valid depth.
pub(super) const NOTHING: f32 = f32::MAX;

#[derive(Clone, Debug, Default)]
pub(super) struct Planes {
    /// Depth, world units; [`NOTHING`] at unusable pixels and in the border.
    pub z: Vec<f32>,
    /// `1 / z`; undefined where `z` is [`NOTHING`].
    pub inverse: Vec<f32>,
    /// Half-width of the depth noise, world units; undefined where `z` is [`NOTHING`].
    pub noise: Vec<f32>,
    /// Ray slopes (x per unit of depth) of the columns, zero-padded to whole vectors.
    pub slope_x: Vec<f32>,
    pub slope_y: Vec<f32>,
    /// Number of values from one row to the next.
    pub stride: usize,
    size: [usize; 2],
    table: Table,
    lengths: Vec<f32>,
    /// Opaque row, used for photographs of a separate camera, whose alpha does not mask the depth image.
    opaque: Vec<[u8; 4]>,
}

/// Replaces the planes by a frame's depth. Writes the measured range and the status of every pixel.
/// Usable pixels get the status [`PixelStatus::Kept`], which later filters may change.
pub(super) struct FillPlanes<'a> {
    pub planes: &'a mut Planes,
    pub frame: &'a Frame,
    pub depth: &'a Depth,
    pub profile: &'a Profile,
    pub calibration: &'a Calibration,
    pub ranges: &'a mut Image<f32>,
    pub statuses: &'a mut Image<PixelStatus>,
}

impl Kernel for FillPlanes<'_> {
    type Output = ();

    // Loops over slices, which the compiler vectorises for the instruction set in use.
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { planes, frame, depth, profile, calibration, ranges, statuses } = self;
        planes.resize(&frame.camera.intrinsics, depth.size());
        let decoding = Decoding::new(depth, profile.offset, calibration);
        // Moved out while rows are filled, which borrows all of `planes`.
        let mut table = std::mem::take(&mut planes.table);
        table.fill(decoding);
        let out = (ranges, statuses);
        match &depth.codes {
            DepthCodes::Inverse8(codes) => {
                let length = |code: u8| table.of(code.into());
                planes.fill_rows(frame, codes, depth.kind, &profile.noise, out, length);
            }
            DepthCodes::Linear16 { codes, .. } => {
                let length = |code: u16| table.of(code.into());
                planes.fill_rows(frame, codes, depth.kind, &profile.noise, out, length);
            }
            DepthCodes::Lengths(lengths) => {
                let length = |length: f32| decoding.usable(decode_length(length));
                planes.fill_rows(frame, lengths, depth.kind, &profile.noise, out, length);
            }
        }
        planes.table = table;
    }
}

impl Planes {
    #[inline(always)]
    pub fn at(&self, column: usize, row: usize) -> usize {
        (row + RADIUS) * self.stride + RADIUS + column
    }

    /// Returns the number of vectors that cover a row of pixels if every `step`-th pixel is used.
    #[inline(always)]
    pub fn blocks(&self, step: usize) -> usize {
        self.size[0].div_ceil(LANES * step)
    }

    fn resize(&mut self, k: &Intrinsics, (width, height): (usize, usize)) {
        // The border is written once; every frame overwrites the rest.
        if self.size != [width, height] {
            self.size = [width, height];
            // Whole vectors and a border: the last block may read past its row, never past the planes.
            self.stride = self.blocks(2) * 2 * LANES + 2 * RADIUS;
            let n = self.stride * (height + 2 * RADIUS);
            for plane in [&mut self.z, &mut self.inverse, &mut self.noise] {
                plane.clear();
                plane.resize(n, NOTHING);
            }
            self.lengths.resize(width, 0.0);
            self.opaque.resize(width, [u8::MAX; 4]);
        }
        // Written for every frame: intrinsics may change without the size.
        self.slope_x.clear();
        self.slope_x.extend((0..width).map(|column| k.ray(column, 0).x as f32));
        self.slope_x.resize(self.blocks(2) * 2 * LANES, 0.0);
        self.slope_y.clear();
        self.slope_y.extend((0..height).map(|row| k.ray(0, row).y as f32));
    }

    #[inline(always)]
    fn fill_rows<C: Copy>(
        &mut self,
        frame: &Frame,
        codes: &Image<C>,
        kind: DepthKind,
        noise: &NoiseLaw,
        (ranges, statuses): (&mut Image<f32>, &mut Image<PixelStatus>),
        length: impl Fn(C) -> (f32, PixelStatus),
    ) {
        let [width, height] = self.size;
        for row in 0..height {
            let pixels = row * width..(row + 1) * width;
            let colors = match frame.color_camera {
                None => &frame.color.data[pixels.clone()],
                Some(_) => &self.opaque,
            };
            let statuses = &mut statuses.data[pixels.clone()];
            let ranges = &mut ranges.data[pixels.clone()];
            read_row(&codes.data[pixels], colors, &mut self.lengths, statuses, &length);
            // Outside the first and last usable pixel of a row, no rays are computed.
            let used = usable_of(statuses);
            let at = self.at(0, row);
            self.z[at..at + used.start].fill(NOTHING);
            self.z[at + used.end..at + width].fill(NOTHING);
            // Lengths of unusable pixels are ranges already: infinite for background, else NaN.
            ranges[..used.start].copy_from_slice(&self.lengths[..used.start]);
            ranges[used.end..].copy_from_slice(&self.lengths[used.end..]);
            let inside = at + used.start..at + used.end;
            let out = Row {
                z: &mut self.z[inside.clone()],
                inverse: &mut self.inverse[inside.clone()],
                noise: &mut self.noise[inside],
                ranges: &mut ranges[used.clone()],
            };
            let (lengths, x) = (&self.lengths[used.clone()], &self.slope_x[used]);
            let y = self.slope_y[row];
            match kind {
                DepthKind::RayDistance => {
                    out.fill(lengths, x, y, noise, |length, per_z| [length / per_z, length]);
                }
                DepthKind::Z => {
                    out.fill(lengths, x, y, noise, |length, per_z| [length, length * per_z]);
                }
            }
        }
    }
}

/// Loads eight values, taking every `STEP`-th value of a row; `STEP` is 1 or 2.
#[inline(always)]
pub(super) fn load<V: Vector, const STEP: usize>(values: &[f32]) -> V {
    if STEP == 1 { V::load(values) } else { V::load_even(values) }
}

struct Row<'a> {
    z: &'a mut [f32],
    inverse: &'a mut [f32],
    noise: &'a mut [f32],
    ranges: &'a mut [f32],
}

impl Row<'_> {
    /// Computes a row from its measured lengths. `split` converts a length and the ray length per unit
    /// of depth to depth and range.
    #[inline(always)]
    fn fill(
        self,
        lengths: &[f32],
        slope_x: &[f32],
        slope_y: f32,
        noise: &NoiseLaw,
        split: impl Fn(f32, f32) -> [f32; 2],
    ) {
        let [ray, floor, linear, quadratic] =
            [noise.ray, noise.floor, noise.linear, noise.quadratic].map(|v| v as f32);
        // Slices of equal length have one bounds check, so that the compiler vectorises the loop.
        let n = self.z.len();
        let (z, inverse, noise) = (&mut self.z[..n], &mut self.inverse[..n], &mut self.noise[..n]);
        let (ranges, lengths, slope_x) = (&mut self.ranges[..n], &lengths[..n], &slope_x[..n]);
        let across = 1.0 + slope_y * slope_y;
        for i in 0..n {
            let per_z = (slope_x[i] * slope_x[i] + across).sqrt();
            let [depth, range] = split(lengths[i], per_z);
            ranges[i] = range;
            // NaN and infinity fail the comparison and become NOTHING.
            z[i] = if depth < NOTHING { depth } else { NOTHING };
            inverse[i] = 1.0 / depth;
            noise[i] =
                (ray / per_z).max(floor).max(linear * depth).max(quadratic * (depth * depth));
        }
    }
}

/// Lengths of all depth codes. The table is reused for frames with the same decoding.
#[derive(Clone, Debug, Default)]
struct Table {
    key: Option<Decoding>,
    /// Length of each code, world units; NaN if unusable.
    lengths: Vec<f32>,
    statuses: Vec<PixelStatus>,
}

impl Table {
    fn fill(&mut self, decoding: Decoding) {
        if self.key == Some(decoding) {
            return;
        }
        self.key = Some(decoding);
        let usable = |decoded| decoding.usable(decoded);
        (self.lengths, self.statuses) = match decoding.codes {
            CodeUnit::Inverse8 => (0..=u8::MAX).map(|d| usable(decode_inverse8(d))).unzip(),
            CodeUnit::Linear16(unit) => {
                (0..=u16::MAX).map(|d| usable(decode_linear16(d, unit))).unzip()
            }
            CodeUnit::None => Default::default(),
        };
    }

    #[inline(always)]
    fn of(&self, code: usize) -> (f32, PixelStatus) {
        (self.lengths[code], self.statuses[code])
    }
}

/// Parameters that, together with the code, determine a length.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decoding {
    codes: CodeUnit,
    trusted: [f64; 2],
    scale: f64,
    offset: f64,
}

#[derive(Clone, Copy, Debug, PartialEq)]
enum CodeUnit {
    /// Codes of `8·(1 − d/255)` world units.
    Inverse8,
    /// Codes with a constant step, world units.
    Linear16(f64),
    /// No codes: the image stores lengths.
    None,
}

impl Decoding {
    fn new(depth: &Depth, offset: f64, calibration: &Calibration) -> Self {
        let codes = match depth.codes {
            DepthCodes::Inverse8(_) => CodeUnit::Inverse8,
            DepthCodes::Linear16 { unit, .. } => CodeUnit::Linear16(unit),
            DepthCodes::Lengths(_) => CodeUnit::None,
        };
        let scale = calibration.depth_scale;
        let offset = offset + calibration.depth_offset;
        Self { codes, trusted: depth.trusted, scale, offset }
    }

    /// Returns the corrected length of a pixel and its status; the length is NaN if unusable. The
    /// trusted interval refers to the sensor's measurement, so it is applied before the correction.
    #[inline(always)]
    fn usable(&self, decoded: Option<f64>) -> (f32, PixelStatus) {
        let Some(decoded) = decoded else { return (f32::NAN, PixelStatus::Hole) };
        let length = decoded * self.scale + self.offset;
        let is_trusted = decoded > self.trusted[0] && decoded < self.trusted[1];
        match is_trusted && length > 0.0 {
            true if LENGTHS.contains(&length) => (length as f32, PixelStatus::Kept),
            true => (f32::NAN, PixelStatus::Far),
            false => (f32::NAN, PixelStatus::Range),
        }
    }
}

/// Decodes a row of codes to lengths and statuses. The length of an unusable pixel is infinite for
/// background, otherwise NaN.
#[inline(always)]
fn read_row<C: Copy>(
    codes: &[C],
    colors: &[[u8; 4]],
    lengths: &mut [f32],
    statuses: &mut [PixelStatus],
    length_of: impl Fn(C) -> (f32, PixelStatus),
) {
    let out = lengths.iter_mut().zip(statuses);
    for ((code, [.., alpha]), (length, status)) in codes.iter().zip(colors).zip(out) {
        let (decoded, found) = length_of(*code);
        // Selections instead of branches: holes and edges are hard to predict.
        let (is_opaque, is_hole) = (*alpha == u8::MAX, found == PixelStatus::Hole);
        // A transparent hole is background: the ray meets no surface, so any former surface there is gone.
        // A hole in an opaque pixel is a missing measurement without information about surfaces.
        let otherwise = if is_hole & (*alpha == 0) { f32::INFINITY } else { f32::NAN };
        *length = if is_opaque { decoded } else { otherwise };
        *status = if is_opaque | is_hole { found } else { PixelStatus::Alpha };
    }
}

#[inline(always)]
fn usable_of(statuses: &[PixelStatus]) -> Range<usize> {
    let is_usable = |status: &PixelStatus| *status == PixelStatus::Kept;
    let first = statuses.iter().position(is_usable).unwrap_or(statuses.len());
    let end = statuses.iter().rposition(is_usable).map_or(first, |last| last + 1);
    first..end
}
