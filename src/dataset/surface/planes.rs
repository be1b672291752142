//! Depth codes to planes of f32 that the fit reads: depth, its inverse and its noise, with a
//! border of nothing so that no window leaves them.
//!
//! What a code means depends on the file, the trusted interval and the calibration, but not on
//! the pixel: a table of all codes is made once and kept between frames, and a pixel is one
//! look-up. Lengths from memory have no codes and are judged one by one. Planes are separate, not
//! a struct per pixel, because the fit loads eight neighbours of one kind at a time.

use super::recipe::{LENGTHS, RADIUS};
use super::sensor::{NoiseLaw, Profile};
use super::status::PixelStatus;
use crate::dataset::calibration::Calibration;
use crate::dataset::depth::{
    Depth, DepthCodes, DepthKind, decode_inverse8, decode_length, decode_linear16,
};
use crate::dataset::frame::Frame;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::simd::{Kernel, LANES, Vector};
use std::ops::Range;

/// Depth where nothing is known; beyond every legal one.
pub(super) const NOTHING: f32 = f32::MAX;

/// Depth along the optical axis of every usable pixel.
#[derive(Clone, Debug, Default)]
pub(super) struct Planes {
    /// Depth, [`NOTHING`] where a pixel is not usable and in the border.
    pub z: Vec<f32>,
    /// `1 / z`; says nothing where `z` is nothing.
    pub inverse: Vec<f32>,
    /// Noise half-width in units of z; says nothing where `z` is nothing.
    pub noise: Vec<f32>,
    /// Slopes of the columns' rays; zeros up to two whole vectors.
    pub slope_x: Vec<f32>,
    /// Slopes of the rows' rays.
    pub slope_y: Vec<f32>,
    size: [usize; 2],
    stride: usize,
    table: Table,
    lengths: Vec<f32>,
    /// A row for photographs by another camera, which hold no mask of the depth image.
    opaque: Vec<[u8; 4]>,
}

/// Replaces the planes by a frame's depth. Writes the measured range of every pixel, and its status as far
/// as it is known: [`PixelStatus::Kept`] where it is usable.
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

    // Loops over slices, which the compiler turns into whatever vectors this is compiled for.
    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { planes, frame, depth, profile, calibration, ranges, statuses } = self;
        planes.resize(&frame.camera.intrinsics, depth.size());
        let decoding = Decoding::new(depth, profile.offset, calibration);
        // Out of the planes while their rows are filled, which borrows all of them.
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
    /// Where a pixel lies in the planes.
    #[inline(always)]
    pub fn at(&self, column: usize, row: usize) -> usize {
        (row + RADIUS) * self.stride + RADIUS + column
    }

    /// Length of a row in the planes.
    #[inline(always)]
    pub fn stride(&self) -> usize {
        self.stride
    }

    /// Vectors that cover a row of pixels, of which one in every `step` is used.
    #[inline(always)]
    pub fn blocks(&self, step: usize) -> usize {
        self.size[0].div_ceil(LANES * step)
    }

    fn resize(&mut self, k: &Intrinsics, (width, height): (usize, usize)) {
        // The border is written once; rows of a frame overwrite all else.
        if self.size != [width, height] {
            self.size = [width, height];
            // Whole vectors and a border: the last block reads past its row, never past the planes.
            self.stride = self.blocks(2) * 2 * LANES + 2 * RADIUS;
            let n = self.stride * (height + 2 * RADIUS);
            for plane in [&mut self.z, &mut self.inverse, &mut self.noise] {
                plane.clear();
                plane.resize(n, NOTHING);
            }
            self.lengths.resize(width, 0.0);
            self.opaque.resize(width, [u8::MAX; 4]);
        }
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
            // Before an object there is nothing to either side of it: no ray need be formed there.
            let used = usable_of(statuses);
            let at = self.at(0, row);
            self.z[at..at + used.start].fill(NOTHING);
            self.z[at + used.end..at + width].fill(NOTHING);
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

/// Eight values, every `STEP`-th of a row: one or two.
#[inline(always)]
pub(super) fn load<V: Vector, const STEP: usize>(values: &[f32]) -> V {
    if STEP == 1 { V::load(values) } else { V::load_even(values) }
}

/// A row of what is filled.
struct Row<'a> {
    z: &'a mut [f32],
    inverse: &'a mut [f32],
    noise: &'a mut [f32],
    ranges: &'a mut [f32],
}

impl Row<'_> {
    /// `split` makes depth and range of a length and the ray's length per unit of depth. One loop
    /// over slices of one length, which the compiler turns into vector code.
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
        let n = self.z.len();
        let (z, inverse, noise) = (&mut self.z[..n], &mut self.inverse[..n], &mut self.noise[..n]);
        let (ranges, lengths, slope_x) = (&mut self.ranges[..n], &lengths[..n], &slope_x[..n]);
        let across = 1.0 + slope_y * slope_y;
        for i in 0..n {
            let per_z = (slope_x[i] * slope_x[i] + across).sqrt();
            let [depth, range] = split(lengths[i], per_z);
            ranges[i] = range;
            // NaN and infinity fail the comparison: both are nothing.
            z[i] = if depth < NOTHING { depth } else { NOTHING };
            inverse[i] = 1.0 / depth;
            noise[i] =
                (ray / per_z).max(floor).max(linear * depth).max(quadratic * (depth * depth));
        }
    }
}

/// Length of every code, kept between frames that decode alike.
#[derive(Clone, Debug, Default)]
struct Table {
    key: Option<Decoding>,
    /// Lengths, NaN where there is no usable one.
    lengths: Vec<f32>,
    /// Whether there is one, or what becomes of a pixel without.
    statuses: Vec<PixelStatus>,
}

impl Table {
    /// Empty for depth that has no codes.
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

/// All that a length depends on beside its code.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decoding {
    codes: CodeUnit,
    trusted: [f64; 2],
    scale: f64,
    offset: f64,
}

/// What a code of the depth image means.
#[derive(Clone, Copy, Debug, PartialEq)]
enum CodeUnit {
    /// `8·(1 − d/255)` world units.
    Inverse8,
    /// World units per step.
    Linear16(f64),
    /// No code: the image holds lengths themselves.
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

    /// The corrected length of a pixel, or NaN and why there is none. Trust is a matter of what the sensor
    /// measured, so the interval holds for the length before it is corrected.
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

/// Decodes a row; a pixel that is not usable gets its range: infinite where nothing is to be seen,
/// else NaN.
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
        // Choices, not branches: holes and edges are where no processor guesses well.
        let (is_opaque, is_hole) = (*alpha == u8::MAX, found == PixelStatus::Hole);
        // A transparent hole is background: the ray meets nothing, so what stood there is missed.
        // A hole in an opaque pixel is no measurement and says nothing of what lies behind it.
        let otherwise = if is_hole & (*alpha == 0) { f32::INFINITY } else { f32::NAN };
        *length = if is_opaque { decoded } else { otherwise };
        *status = if is_opaque | is_hole { found } else { PixelStatus::Alpha };
    }
}

/// From the first usable pixel of a row to behind the last.
#[inline(always)]
fn usable_of(statuses: &[PixelStatus]) -> Range<usize> {
    let is_usable = |status: &PixelStatus| *status == PixelStatus::Kept;
    let first = statuses.iter().position(is_usable).unwrap_or(statuses.len());
    let end = statuses.iter().rposition(is_usable).map_or(first, |last| last + 1);
    first..end
}
