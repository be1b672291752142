//! Converts fitted pixels to points (`dataset.md`, Surface points), eight at a time as they were fitted.
//!
//! For each pixel's plane, the fit yields inverse depth and its change per column and per row, relative
//! to the measured value; depth and normal follow from these. A pixel is then kept, or gets the status
//! of the first filter that drops it. Colour comes last, because a separate colour camera is sampled at
//! the point's position, not the pixel's.

use super::color_lookup::{ColorLookup, SeenLanes};
use super::fit::Fitted;
use super::planes::{Planes, load};
use super::sensor::Profile;
use super::settings::{PixelSampling, SurfaceSettings};
use crate::dataset::frame::Frame;
use crate::dataset::unproject::MAX_COORDINATE;
use crate::math::image::Image;
use crate::math::simd::{Kernel, LANES, SET_LANE, Vector, dot, scaled, turned};
use crate::observation::surface::SurfacePoint;
use std::ops::Range;

pub(super) struct Emitter<'a> {
    planes: &'a Planes,
    settings: &'a SurfaceSettings,
    colors: ColorLookup<'a>,
    /// Rotation matrix from camera axes to world axes, by rows.
    turn: [[f32; 3]; 3],
    /// Camera centre relative to the origin of the points, world units.
    centre: [f32; 3],
    focal: [f32; 2],
    per_focal: f32,
    least_cosine: f32,
}

impl<'a> Emitter<'a> {
    pub fn new(
        frame: &Frame,
        planes: &'a Planes,
        settings: &'a SurfaceSettings,
        profile: &Profile,
        colors: ColorLookup<'a>,
    ) -> Self {
        let pose = &frame.camera.pose;
        let k = &frame.camera.intrinsics;
        let cosine = profile.thresholds.cosine as f32;
        Self {
            planes,
            settings,
            colors,
            turn: pose.rotation().as_mat3().transpose().to_cols_array_2d(),
            // Subtracted in f64: far from zero, f32 would lose the camera's position.
            centre: (pose.centre() - settings.origin).as_vec3().to_array(),
            focal: [k.fx as f32, k.fy as f32],
            per_focal: (1.0 / k.fx) as f32,
            // Without the filter, a bound below every cosine: one comparison serves both cases.
            least_cosine: if settings.cosine { cosine } else { f32::NEG_INFINITY },
        }
    }
}

/// Appends the points of a row of tiles (blocks of pixels) and writes the statuses of its pixels.
pub(super) struct EmitRows<'a> {
    pub emitter: &'a Emitter<'a>,
    pub fitted: &'a Fitted,
    pub rows: Range<usize>,
    pub points: &'a mut Vec<SurfacePoint>,
    pub statuses: &'a mut Image<PixelStatus>,
}

impl Kernel for EmitRows<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { emitter, fitted, rows, points, statuses } = self;
        let sampling = emitter.settings.sampling;
        let step = sampling.step();
        let blocks = emitter.planes.blocks(step);
        if !sampling.is_every() {
            mark_skipped(sampling, rows.clone(), statuses);
        }
        for block in 0..blocks {
            for row in rows.clone().step_by(step) {
                let at = (row - rows.start) * blocks + block;
                let mut left = fitted.usable[at];
                // Blocks at the border of an object have few usable pixels, most blocks beyond it none.
                if left == 0 {
                    continue;
                }
                let first = block * LANES * step;
                // A constant step, so that the kind of load is chosen at compile time.
                let lanes = match step {
                    1 => emitter.lanes::<V, 1>(fitted, at, [first, row]),
                    _ => emitter.lanes::<V, 2>(fitted, at, [first, row]),
                };
                // In pixel order: births depend on the order of points.
                while left != 0 {
                    let lane = left.trailing_zeros() as usize;
                    left &= left - 1;
                    let pixel = row * statuses.width + first + lane * step;
                    match lanes.point(&emitter.colors, lane, pixel) {
                        Ok(point) => points.push(point),
                        Err(why) => statuses.data[pixel] = why,
                    }
                }
            }
        }
    }
}

impl Emitter<'_> {
    /// Computes the points of eight pixels, taking every `STEP`-th pixel from `corner` (column, row).
    /// `at` is the index of their block in `fitted`.
    #[inline(always)]
    fn lanes<V: Vector, const STEP: usize>(
        &self,
        fitted: &Fitted,
        at: usize,
        corner: [usize; 2],
    ) -> PointLanes {
        let one = V::splat(1.0);
        let [column, row] = corner;
        let ray = [
            load::<V, STEP>(&self.planes.slope_x[column..]),
            V::splat(self.planes.slope_y[row]),
            one,
        ];
        let per_z = dot(ray, ray).sqrt();
        let surface = self.surface(fitted, at, ray, per_z);
        let normal_length = dot(surface.normal, surface.normal).sqrt();
        // The cosine is `along / (|n|·|ray|)`; the test is multiplied out to avoid divisions.
        let least = V::splat(self.least_cosine) * (normal_length * per_z);
        let planes = self.planes.at(column, row);
        let z = load::<V, STEP>(&self.planes.z[planes..]) * surface.stretch;
        let local = scaled(ray, z);
        let [x, y, ahead] = turned(&self.turn, local);
        let [right, down, front] = self.centre;
        let position = [x + V::splat(right), y + V::splat(down), ahead + V::splat(front)];
        let far = !(within(position[0]) & within(position[1]) & within(position[2])) as u8;
        let range = z * per_z;
        // The fitted normal points away from the camera, a point's towards it.
        let normal = scaled(surface.normal, V::splat(-1.0) / normal_length);
        PointLanes {
            flying: if self.settings.flying_pixels { !fitted.accepted[at] } else { 0 },
            slant: surface.along.at_most(least) as u8,
            far,
            seen: self.colors.seen_lanes(local),
            position: to_arrays(position),
            range: range.to_array(),
            noise: (load::<V, STEP>(&self.planes.noise[planes..]) * per_z).to_array(),
            normal: to_arrays(turned(&self.turn, normal)),
            footprint: (range * V::splat(self.per_focal)).to_array(),
            direction: to_arrays(turned(&self.turn, scaled(ray, one / per_z))),
        }
    }

    /// Computes the surfaces of eight pixels. Normals of fitted planes point away from the camera;
    /// their dot product with the ray is the fitted inverse depth divided by the measured one.
    #[inline(always)]
    fn surface<V: Vector>(&self, fitted: &Fitted, at: usize, ray: [V; 3], per_z: V) -> Surface<V> {
        let one = V::splat(1.0);
        let place = at * LANES;
        let along = one + V::load(&fitted.excess[place..]);
        let x = V::load(&fitted.step_x[place..]) * V::splat(self.focal[0]);
        let y = V::load(&fitted.step_y[place..]) * V::splat(self.focal[1]);
        let normal = [x, y, along - x * ray[0] - y * ray[1]];
        // The plane yields the normal even if the measured depth is retained.
        let stretch = if self.settings.plane_fit { one / along } else { one };
        let planar = Surface { stretch, normal, along };
        if self.settings.flying_pixels {
            return planar;
        }
        // Without the filter, a pixel without a plane keeps its own depth and faces the camera.
        let mut accepted = [0.0; LANES];
        for (lane, accepted_lane) in accepted.iter_mut().enumerate() {
            *accepted_lane = if fitted.accepted[at] >> lane & 1 == 1 { SET_LANE } else { 0.0 };
        }
        let accepted = V::load(&accepted);
        Surface {
            stretch: V::select(accepted, planar.stretch, one),
            normal: [
                V::select(accepted, planar.normal[0], ray[0]),
                V::select(accepted, planar.normal[1], ray[1]),
                V::select(accepted, planar.normal[2], ray[2]),
            ],
            along: V::select(accepted, planar.along, per_z * per_z),
        }
    }
}

/// Surfaces of eight pixels in the camera's frame, relative to the measured depths.
struct Surface<V> {
    /// Ratio of fitted to measured depth.
    stretch: V,
    normal: [V; 3],
    along: V,
}

/// Eight points in separate lanes, with fields as in [`SurfacePoint`]. `flying`, `slant` and `far` have
/// one bit per dropped lane.
struct PointLanes {
    flying: u8,
    slant: u8,
    far: u8,
    seen: SeenLanes,
    position: [[f32; LANES]; 3],
    range: [f32; LANES],
    noise: [f32; LANES],
    normal: [[f32; LANES]; 3],
    footprint: [f32; LANES],
    direction: [[f32; LANES]; 3],
}

impl PointLanes {
    #[inline(always)]
    fn point(
        &self,
        colors: &ColorLookup<'_>,
        lane: usize,
        pixel: usize,
    ) -> Result<SurfacePoint, PixelStatus> {
        let has = |bits: u8| bits >> lane & 1 == 1;
        if has(self.flying) {
            return Err(PixelStatus::Flying);
        }
        if has(self.slant) {
            return Err(PixelStatus::Slant);
        }
        if has(self.far) {
            return Err(PixelStatus::Far);
        }
        let color = colors.color(pixel, &self.seen, lane).ok_or(PixelStatus::NoColor)?;
        Ok(SurfacePoint {
            position: of_lane(&self.position, lane),
            range: self.range[lane],
            color,
            noise: self.noise[lane],
            normal: of_lane(&self.normal, lane),
            footprint: self.footprint[lane],
            direction: of_lane(&self.direction, lane),
            pixel: pixel as u32,
        })
    }
}

/// Returns a bit mask of the lanes within the range of f32 positions; NaN is outside.
#[inline(always)]
fn within<V: Vector>(x: V) -> u32 {
    x.at_most(V::splat(MAX_COORDINATE)) & V::splat(-MAX_COORDINATE).at_most(x)
}

#[inline(always)]
fn to_arrays<V: Vector>([x, y, z]: [V; 3]) -> [[f32; LANES]; 3] {
    [x.to_array(), y.to_array(), z.to_array()]
}

#[inline(always)]
fn of_lane([x, y, z]: &[[f32; LANES]; 3], lane: usize) -> [f32; 3] {
    [x[lane], y[lane], z[lane]]
}

/// Marks the usable pixels that the sampling skips in the given rows. The first row must be even.
#[inline(always)]
fn mark_skipped(sampling: PixelSampling, rows: Range<usize>, statuses: &mut Image<PixelStatus>) {
    let (width, step) = (statuses.width, sampling.step());
    for row in rows {
        let is_used = row.is_multiple_of(step);
        for (column, status) in statuses.data[row * width..][..width].iter_mut().enumerate() {
            let is_left_out = !is_used || column % step != 0;
            // Written unconditionally, so that the loop vectorises.
            *status = match is_left_out && *status == PixelStatus::Kept {
                true => PixelStatus::LeftOut,
                false => *status,
            };
        }
    }
}

/// Status of a pixel: kept as a point, or the reason why it was dropped.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[repr(u8)]
pub enum PixelStatus {
    /// No surface was measured.
    #[default]
    Hole,
    /// The pixel was converted to a point.
    Kept,
    /// Skipped by the sampling, and represented by a neighbouring pixel's point.
    LeftOut,
    /// Partially transparent: colour and depth are mixtures of several surfaces.
    Alpha,
    /// Depth outside the trusted interval, or behind the camera after correction.
    Range,
    /// No accepted plane: too few inliers, too large residuals, or the pixel's depth is too far from the
    /// plane.
    Flying,
    /// Seen at a slant: the normal deviates too far from the direction to the camera.
    Slant,
    /// Position not finite, or too far from the origin for f32.
    Far,
    /// Not visible in the colour camera: outside its image, or occluded.
    NoColor,
}

/// Numbers of pixels of one frame by status. The fields add up to width × height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct SurfaceCounts {
    /// Number of pixels that were converted to points.
    pub kept: usize,
    /// Number of pixels with the status [`PixelStatus::LeftOut`].
    pub left_out: usize,
    /// Number of pixels with the status [`PixelStatus::Hole`].
    pub holes: usize,
    /// Number of pixels with the status [`PixelStatus::Alpha`].
    pub dropped_alpha: usize,
    /// Number of pixels with the status [`PixelStatus::Range`].
    pub dropped_range: usize,
    /// Number of pixels with the status [`PixelStatus::Flying`].
    pub dropped_flying: usize,
    /// Number of pixels with the status [`PixelStatus::Slant`].
    pub dropped_slant: usize,
    /// Number of pixels with the status [`PixelStatus::Far`].
    pub dropped_far: usize,
    /// Number of pixels with the status [`PixelStatus::NoColor`].
    pub dropped_no_color: usize,
}

impl std::fmt::Display for SurfaceCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "{} holes, {} flying, {} at a slant, {} out of range, {} transparent, {} outside the colour image",
            self.holes,
            self.dropped_flying,
            self.dropped_slant,
            self.dropped_range,
            self.dropped_alpha,
            self.dropped_no_color
        )
    }
}

impl SurfaceCounts {
    /// Counts the pixels of a frame by status.
    pub fn of(statuses: &[PixelStatus]) -> Self {
        // One pass per status with sums of bytes vectorises; a histogram does not.
        let of = |status: PixelStatus| {
            // A byte holds the count of 255 pixels.
            let count =
                |run: &[PixelStatus]| run.iter().map(|f| u8::from(*f == status)).sum::<u8>();
            statuses.chunks(usize::from(u8::MAX)).map(|run| usize::from(count(run))).sum()
        };
        Self {
            kept: of(PixelStatus::Kept),
            left_out: of(PixelStatus::LeftOut),
            holes: of(PixelStatus::Hole),
            dropped_alpha: of(PixelStatus::Alpha),
            dropped_range: of(PixelStatus::Range),
            dropped_flying: of(PixelStatus::Flying),
            dropped_slant: of(PixelStatus::Slant),
            dropped_far: of(PixelStatus::Far),
            dropped_no_color: of(PixelStatus::NoColor),
        }
    }

    /// Returns the number of measured pixels that were dropped.
    pub fn dropped(&self) -> usize {
        self.dropped_alpha
            + self.dropped_range
            + self.dropped_flying
            + self.dropped_slant
            + self.dropped_far
            + self.dropped_no_color
    }
}
