//! Fitted pixels to points (`dataset.md`, Surface points).
//!
//! The fit leaves, of every pixel's plane, inverse depth and its two steps relative to the
//! measured ones. Depth and normal follow from these; a pixel is then kept or gets its status in
//! the order of the recipe. Colour comes last, since a colour camera beside the depth camera is
//! asked for the place of the point, not of the pixel.

use super::color_lookup::ColorLookup;
use super::fit::Fitted;
use super::occluders::Occluders;
use super::planes::Planes;
use super::sampling::PixelSampling;
use super::sensor::Profile;
use super::settings::SurfaceSettings;
use super::status::PixelStatus;
use crate::dataset::frame::Frame;
use crate::dataset::unproject::MAX_COORDINATE;
use crate::math::image::Image;
use crate::math::simd::LANES;
use crate::observation::surface::SurfacePoint;
use glam::{Mat3, Vec3};
use std::ops::Range;

/// Makes the points of one frame.
pub(super) struct Emitter<'a> {
    planes: &'a Planes,
    settings: &'a SurfaceSettings,
    colors: ColorLookup<'a>,
    rotation: Mat3,
    /// Of the camera, relative to the origin.
    centre: Vec3,
    focal: [f32; 2],
    per_focal: f32,
    least_cosine: f32,
}

/// A pixel's surface in the camera's frame, scaled by its measured depth.
struct Tilt {
    /// Depth over that measured.
    stretch: f32,
    /// Away from the camera, of any length.
    normal: Vec3,
    /// Product of the normal with the ray.
    along: f32,
}

impl<'a> Emitter<'a> {
    pub fn new(
        frame: &'a Frame,
        planes: &'a Planes,
        settings: &'a SurfaceSettings,
        profile: &Profile,
        occluders: &'a mut Occluders,
    ) -> Self {
        let pose = &frame.camera.pose;
        let k = &frame.camera.intrinsics;
        let cosine = profile.thresholds.cosine as f32;
        Self {
            planes,
            settings,
            colors: ColorLookup::new(
                frame,
                planes,
                settings.calibration(),
                &profile.tolerance,
                occluders,
            ),
            rotation: pose.rotation().as_mat3(),
            centre: (pose.centre() - settings.origin).as_vec3(),
            focal: [k.fx as f32, k.fy as f32],
            per_focal: (1.0 / k.fx) as f32,
            // Below every cosine where the filter is left out: one comparison serves both.
            least_cosine: if settings.cosine { cosine } else { f32::NEG_INFINITY },
        }
    }

    /// Appends the points of a row of tiles and says what became of its pixels.
    pub fn emit(
        &self,
        fitted: &Fitted,
        rows: Range<usize>,
        points: &mut Vec<SurfacePoint>,
        statuses: &mut Image<PixelStatus>,
    ) {
        let blocks = self.planes.blocks();
        let sampling = self.settings.sampling;
        if !sampling.is_every() {
            leave_out(sampling, rows.clone(), statuses);
        }
        for block in 0..blocks {
            for row in rows.clone().step_by(sampling.row_step()) {
                let at = (row - rows.start) * blocks + block;
                // Set bits only: blocks at the rim of an object hold few usable pixels.
                let mut left = fitted.usable[at];
                while left != 0 {
                    // In the order of pixels: births depend on the order of points.
                    let lane = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let is_accepted = fitted.accepted[at] >> lane & 1 == 1;
                    let tilt = is_accepted.then_some(at * LANES + lane);
                    let column = block * LANES + lane;
                    let status = &mut statuses.data[row * statuses.width + column];
                    match self.point(fitted, tilt, column, row) {
                        Ok(point) => points.push(point),
                        Err(why) => *status = why,
                    }
                }
            }
        }
    }

    /// `tilt` is the place of the pixel's plane, if one explains it.
    #[inline(always)]
    fn point(
        &self,
        fitted: &Fitted,
        tilt: Option<usize>,
        column: usize,
        row: usize,
    ) -> Result<SurfacePoint, PixelStatus> {
        let at = self.planes.at(column, row);
        let ray = Vec3::new(self.planes.slope_x[column], self.planes.slope_y[row], 1.0);
        let per_z = ray.length();
        let tilt = match tilt {
            Some(place) => self.tilt(fitted, place, ray),
            None if self.settings.flying_pixels => return Err(PixelStatus::Flying),
            None => Tilt { stretch: 1.0, normal: ray, along: per_z * per_z },
        };
        let normal_length = tilt.normal.length();
        // The cosine is `along / (|n|·|ray|)`; multiplied out, nothing is divided.
        if tilt.along <= self.least_cosine * (normal_length * per_z) {
            return Err(PixelStatus::Slant);
        }
        let z = self.planes.z[at] * tilt.stretch;
        let local = ray * z;
        let position = self.rotation * local + self.centre;
        // Negated, so that NaN is too far as well.
        if !position.abs().cmple(Vec3::splat(MAX_COORDINATE)).all() {
            return Err(PixelStatus::Far);
        }
        let pixel = row * self.planes.slope_x.len() + column;
        let color = self.colors.color(pixel, local).ok_or(PixelStatus::NoColor)?;
        let range = z * per_z;
        Ok(SurfacePoint {
            position: position.to_array(),
            range,
            color,
            noise: self.planes.noise[at] * per_z,
            normal: (self.rotation * (tilt.normal * (-1.0 / normal_length))).to_array(),
            footprint: range * self.per_focal,
            direction: (self.rotation * (ray * (1.0 / per_z))).to_array(),
            pixel: pixel as u32,
        })
    }

    /// Turned away from the camera, so that the product with the ray is what remains of
    /// the inverse depth itself.
    #[inline(always)]
    fn tilt(&self, fitted: &Fitted, place: usize, ray: Vec3) -> Tilt {
        let along = 1.0 + fitted.excess[place];
        let (x, y) = (fitted.step_x[place] * self.focal[0], fitted.step_y[place] * self.focal[1]);
        // The plane gives the normal even where depth stays as measured.
        let stretch = if self.settings.plane_fit { 1.0 / along } else { 1.0 };
        Tilt { stretch, normal: Vec3::new(x, y, along - x * ray.x - y * ray.y), along }
    }
}

/// Marks the usable pixels of some rows, the first an even one, that are not looked at.
fn leave_out(sampling: PixelSampling, rows: Range<usize>, statuses: &mut Image<PixelStatus>) {
    let width = statuses.width;
    for row in rows {
        let is_used = row.is_multiple_of(sampling.row_step());
        let lanes = if is_used { sampling.lanes() } else { 0 };
        for (column, status) in statuses.data[row * width..][..width].iter_mut().enumerate() {
            let is_left_out = lanes >> (column % LANES) & 1 == 0;
            if is_left_out && *status == PixelStatus::Kept {
                *status = PixelStatus::LeftOut;
            }
        }
    }
}
