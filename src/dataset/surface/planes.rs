//! Depth codes to planes of f32 that the fit reads: depth, its inverse and its noise, with a border
//! of nothing so that no window leaves them.

use super::fates::PixelFate;
use super::sensor::{NoiseLaw, Profile};
use super::{LENGTHS, RADIUS};
use crate::dataset::calibration::Calibration;
use crate::dataset::frame::{
    Depth, DepthCodes, DepthKind, Frame, decode_inverse8, decode_linear16,
};
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::simd::LANES;

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
    /// Slopes of the columns' rays.
    pub slope_x: Vec<f32>,
    /// Slopes of the rows' rays.
    pub slope_y: Vec<f32>,
    size: [usize; 2],
    stride: usize,
    table: Table,
    lengths: Vec<f32>,
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

    /// Vectors that cover a row of pixels.
    #[inline(always)]
    pub fn blocks(&self) -> usize {
        self.size[0].div_ceil(LANES)
    }

    /// Replaces the planes by a frame's depth. Writes the measured range of every pixel, and its
    /// fate as far as it is known: [`PixelFate::Kept`] where it is usable.
    pub fn fill(
        &mut self,
        frame: &Frame,
        depth: &Depth,
        profile: &Profile,
        calibration: &Calibration,
        ranges: &mut Image<f32>,
        fates: &mut Image<PixelFate>,
    ) {
        self.resize(&frame.camera.intrinsics, depth.size());
        self.table.fill(depth, profile.offset, calibration);
        match &depth.codes {
            DepthCodes::Inverse8(codes) => {
                self.fill_rows(frame, codes, depth.kind, &profile.noise, ranges, fates);
            }
            DepthCodes::Linear16 { codes, .. } => {
                self.fill_rows(frame, codes, depth.kind, &profile.noise, ranges, fates);
            }
        }
    }

    fn resize(&mut self, k: &Intrinsics, (width, height): (usize, usize)) {
        if self.size != [width, height] {
            self.size = [width, height];
            self.stride = self.blocks() * LANES + 2 * RADIUS;
            let n = self.stride * (height + 2 * RADIUS);
            for plane in [&mut self.z, &mut self.inverse, &mut self.noise] {
                plane.clear();
                plane.resize(n, NOTHING);
            }
            self.lengths.resize(width, 0.0);
        }
        self.slope_x.clear();
        self.slope_x.extend((0..width).map(|column| k.ray(column, 0).x as f32));
        self.slope_y.clear();
        self.slope_y.extend((0..height).map(|row| k.ray(0, row).y as f32));
    }

    fn fill_rows<C: Copy + Into<usize>>(
        &mut self,
        frame: &Frame,
        codes: &Image<C>,
        kind: DepthKind,
        noise: &NoiseLaw,
        ranges: &mut Image<f32>,
        fates: &mut Image<PixelFate>,
    ) {
        let [width, height] = self.size;
        for row in 0..height {
            let pixels = row * width..(row + 1) * width;
            let colors = &frame.color.data[pixels.clone()];
            let fates = &mut fates.data[pixels.clone()];
            let ranges = &mut ranges.data[pixels.clone()];
            let some = self.table.look_up(&codes.data[pixels], colors, &mut self.lengths, fates);
            let at = self.at(0, row);
            let row_of = at..at + width;
            if !some {
                self.z[row_of].fill(NOTHING);
                ranges.copy_from_slice(&self.lengths);
                continue;
            }
            let out = Row {
                z: &mut self.z[row_of.clone()],
                inverse: &mut self.inverse[row_of.clone()],
                noise: &mut self.noise[row_of],
                ranges,
            };
            let (lengths, x, y) = (&self.lengths, &self.slope_x, self.slope_y[row]);
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
    /// Length, or what becomes of a pixel without a usable one.
    lengths: Vec<Result<f32, PixelFate>>,
}

/// All that a length depends on.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Decoding {
    /// World units per code; `None` for 8-bit depth.
    unit: Option<f64>,
    trusted: [f64; 2],
    scale: f64,
    offset: f64,
}

impl Table {
    fn fill(&mut self, depth: &Depth, offset: f64, calibration: &Calibration) {
        let unit = match depth.codes {
            DepthCodes::Inverse8(_) => None,
            DepthCodes::Linear16 { unit, .. } => Some(unit),
        };
        let scale = calibration.depth_scale;
        let offset = offset + calibration.depth_offset;
        let key = Decoding { unit, trusted: depth.trusted, scale, offset };
        if self.key == Some(key) {
            return;
        }
        self.key = Some(key);
        let usable = |decoded: Option<f64>| {
            let decoded = decoded.ok_or(PixelFate::Hole)?;
            let length = decoded * scale + offset;
            match depth.trusts(decoded) && length > 0.0 {
                true if LENGTHS.contains(&length) => Ok(length as f32),
                true => Err(PixelFate::Far),
                false => Err(PixelFate::Range),
            }
        };
        self.lengths.clear();
        match unit {
            None => self.lengths.extend((0..=u8::MAX).map(|d| usable(decode_inverse8(d)))),
            Some(unit) => {
                self.lengths.extend((0..=u16::MAX).map(|d| usable(decode_linear16(d, unit))));
            }
        }
    }

    /// Decodes a row; a pixel that is not usable gets its range: infinite where nothing is to be
    /// seen, else NaN. Whether any is usable.
    fn look_up<C: Copy + Into<usize>>(
        &self,
        codes: &[C],
        colors: &[[u8; 4]],
        lengths: &mut [f32],
        fates: &mut [PixelFate],
    ) -> bool {
        let mut some = false;
        let out = lengths.iter_mut().zip(fates);
        for ((code, [.., alpha]), (length, fate)) in codes.iter().zip(colors).zip(out) {
            (*length, *fate) = match (self.lengths[(*code).into()], alpha) {
                (Err(PixelFate::Hole), 0) => (f32::INFINITY, PixelFate::Hole),
                (Err(PixelFate::Hole), _) => (f32::NAN, PixelFate::Hole),
                (Ok(length), 255) => {
                    some = true;
                    (length, PixelFate::Kept)
                }
                (Err(fate), 255) => (f32::NAN, fate),
                _ => (f32::NAN, PixelFate::Alpha),
            };
        }
        some
    }
}
