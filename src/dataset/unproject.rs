//! Unprojection of frames to coloured points for the published algorithm (`dataset.md`, Unprojection), in
//! tile order (`dataset.md`, Tile order).
//!
//! Two passes over the image. The first classifies every pixel row by row with SIMD: a hole, kept, or
//! dropped for a reason. The second converts the kept pixels to points, tile by tile (`tile_points`).
//!
//! Two flaws of the published loader are options, because the published results depend on them. They
//! are rays through pixel corners with a small-angle formula ([`CameraConvention::Paper`]) and no
//! filter of flying pixels ([`EdgeFilter::Off`]). Rays are rotated and scaled in f64; only the point is
//! rounded.

use super::depth::{
    Depth, DepthCodes, DepthKind, decode_inverse8, decode_length, decode_linear16, sensor_noise,
};
use super::error::FrameError;
use super::frame::Frame;
use super::tile_points::{Emission, Placement, Slope, Slopes, Status, TILE, local_points};
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::measured_pixel::Normalization;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::observation::points::Points;
use glam::{DMat3, DVec3};

/// Largest absolute value of a normalised coordinate. Points beyond it are dropped as implausible. At
/// this value, `f32` has a step of 0.008.
pub const MAX_COORDINATE: f32 = 65536.0;

/// Conversion of pixels to rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraConvention {
    /// As in the published loader (`dataset.md`, Unprojection): rays through pixel corners, and a
    /// small-angle formula that converts ray distance to depth.
    Paper,
    /// Exact rays through pixel centres.
    Exact,
}

/// Filter for pixels that mix two surfaces.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EdgeFilter {
    /// Every pixel with trusted depth becomes a point, opaque or not.
    Off,
    /// Drops pixels of partial alpha and pixels between two surfaces (`dataset.md`, Edge filter).
    DropMixed,
}

/// Numbers of pixels of one frame by outcome; the fields add up to width × height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Pixels that became points.
    pub kept: usize,
    /// Pixels without measured depth.
    pub holes: usize,
    /// Measured pixels whose colour is partially transparent.
    pub dropped_alpha: usize,
    /// Measured pixels that mix two surfaces.
    pub dropped_edge: usize,
    /// Measured pixels outside the trusted depth.
    pub dropped_range: usize,
    /// Measured pixels whose point is not finite or is beyond [`MAX_COORDINATE`].
    pub dropped_far: usize,
}

impl std::fmt::Display for PointCounts {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { holes, dropped_edge, dropped_range, dropped_alpha, .. } = self;
        write!(
            f,
            "{holes} holes, {dropped_edge} at edges, {dropped_range} out of range, {dropped_alpha} transparent"
        )
    }
}

impl PointCounts {
    /// Returns the number of pixels with measured depth that gave no point.
    pub fn dropped(&self) -> usize {
        self.dropped_alpha + self.dropped_edge + self.dropped_range + self.dropped_far
    }
}

/// Settings of the unprojection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnprojectSettings {
    /// Conversion of pixels to rays.
    pub convention: CameraConvention,
    /// Filter for mixed pixels.
    pub filter: EdgeFilter,
    /// Map from world to model coordinates.
    pub normalization: Normalization,
}

/// Returns the camera-space point (OpenCV axes, world units) of the pixel `[column, row]` (`dataset.md`,
/// Unprojection). `value` is its depth in world units, measured along `kind`.
/// [`CameraConvention::Paper`] uses half the image width in its formula for both axes.
pub fn camera_point(
    k: &Intrinsics,
    convention: CameraConvention,
    kind: DepthKind,
    [column, row]: [usize; 2],
    value: f64,
) -> DVec3 {
    let rule = RayRule::new(k, convention);
    let Slope { tangent, stretch } = rule.column(column);
    let [[x], [y], [z]] = local_points([[tangent], [stretch]], rule.row(row), kind, [value]);
    DVec3::new(x, y, z)
}

struct RayRule<'a> {
    k: &'a Intrinsics,
    /// Offset from pixel index to pixel coordinate, pixels.
    shift: f64,
    /// Angle per pixel in the published small-angle formula, radians: `(θ/2)/(w/2 − 1)`. `θ` is the
    /// horizontal field of view, `w` the image width. `None` for exact rays.
    small_angle: Option<f64>,
}

impl<'a> RayRule<'a> {
    fn new(k: &'a Intrinsics, convention: CameraConvention) -> Self {
        match convention {
            // Pixel centres are at half integers.
            CameraConvention::Exact => Self { k, shift: 0.5, small_angle: None },
            CameraConvention::Paper => {
                // The published formula uses the width for both axes, and half of it minus one pixel.
                let half_width = 0.5 * f64::from(k.width);
                let small_angle = Some(0.5 * k.fov_x() / (half_width - 1.0));
                Self { k, shift: 0.0, small_angle }
            }
        }
    }

    fn slope(&self, index: usize, principal: f64, focal: f64) -> Slope {
        let offset = index as f64 + self.shift - principal;
        let tangent = offset / focal;
        let per_depth = self.small_angle.map_or(tangent, |per_pixel| offset * per_pixel);
        Slope { tangent, stretch: per_depth * per_depth }
    }

    fn column(&self, column: usize) -> Slope {
        self.slope(column, self.k.cx, self.k.fx)
    }

    fn row(&self, row: usize) -> Slope {
        self.slope(row, self.k.cy, self.k.fy)
    }
}

/// Converts frames to points; reuses its scratch memory between frames.
///
/// ```
/// use vbgs_studio::dataset::unproject::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
/// use vbgs_studio::dataset::range::PositionRange;
/// use vbgs_studio::dataset::synthetic::{self, SyntheticParams};
/// use vbgs_studio::observation::points::Points;
///
/// let small = SyntheticParams { width: 32, height: 24, n_train: 6, n_eval: 1, ..SyntheticParams::demo() };
/// let room = synthetic::dataset(&small)?;
/// let settings = UnprojectSettings {
///     convention: CameraConvention::Exact,
///     filter: EdgeFilter::Off,
///     normalization: PositionRange::nerf_synthetic().normalization(),
/// };
/// let mut points = Points::new();
/// let counts = Unprojector::new().unproject(&room.load(0, 0)?, &settings, &mut points)?;
/// assert_eq!((counts.kept, points.len(), points.n_tiles()), (32 * 24, 32 * 24, 12));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
#[derive(Clone, Debug, Default)]
pub struct Unprojector {
    levels: Padded<u8>,
    lengths: Padded<f32>,
    mixed: Vec<u8>,
    /// One [`Status`] per pixel; rows and columns are padded to whole tiles with [`Status::Hole`].
    statuses: Vec<u8>,
    columns: Slopes,
    rows: Vec<Slope>,
}

impl Unprojector {
    /// Creates an unprojector; memory is allocated by the first frame.
    pub fn new() -> Self {
        Self::default()
    }

    /// Replaces `out` by the normalised points of the frame, and returns pixel counts by outcome. The
    /// points of 8×8 pixels form a tile; tiles are in rows from the top. A tile has four quads of 4×4
    /// pixels, each read in rows of 4 pixels.
    ///
    /// # Errors
    /// The frame has no depth.
    pub fn unproject(
        &mut self,
        frame: &Frame,
        settings: &UnprojectSettings,
        out: &mut Points<f32>,
    ) -> Result<PointCounts, FrameError> {
        out.clear();
        // Colours are read at depth's pixels; a separate colour camera has another grid.
        let registered = frame.with_registered_color();
        let frame = registered.as_ref();
        let depth = frame.require_depth()?;
        let mut tally = [0usize; 5];
        match &depth.codes {
            DepthCodes::Inverse8(codes) => {
                self.classify_levels(frame, depth, codes, settings.filter, &mut tally);
                // Holes have length 0, which is never read because they are not kept.
                let lengths: [f64; 256] =
                    std::array::from_fn(|d| decode_inverse8(d as u8).unwrap_or(0.0));
                let length = |code: u8| lengths[code as usize];
                self.emit(frame, depth.kind, settings, out, &codes.data, length);
            }
            DepthCodes::Linear16 { codes, unit } => {
                let length = |code: u16| decode_linear16(code, *unit).unwrap_or(f64::NAN);
                self.classify_lengths(frame, depth, codes, length, settings.filter, &mut tally);
                // Holes are not kept, so their codes are not converted here.
                let length = |code: u16| f64::from(code) * unit;
                self.emit(frame, depth.kind, settings, out, &codes.data, length);
            }
            DepthCodes::Lengths(lengths) => {
                let filter = settings.filter;
                let length = |stored: f32| decode_length(stored).unwrap_or(f64::NAN);
                self.classify_lengths(frame, depth, lengths, length, filter, &mut tally);
                self.emit(frame, depth.kind, settings, out, &lengths.data, f64::from);
            }
        }
        // Distance is checked on the point itself, after its status was counted.
        let planned = tally[Status::Kept as usize];
        Ok(PointCounts {
            kept: out.len(),
            holes: tally[Status::Hole as usize],
            dropped_alpha: tally[Status::Alpha as usize],
            dropped_edge: tally[Status::Edge as usize],
            dropped_range: tally[Status::Range as usize],
            dropped_far: planned - out.len(),
        })
    }

    fn classify_levels(
        &mut self,
        frame: &Frame,
        depth: &Depth,
        codes: &Image<u8>,
        filter: EdgeFilter,
        tally: &mut [usize; 5],
    ) {
        let plain: [u8; 256] = std::array::from_fn(|d| match (d, decode_inverse8(d as u8)) {
            (0, _) => Status::Hole as u8,
            (_, Some(length)) if depth.is_trusted(length) => Status::Kept as u8,
            // Includes code 255: the camera centre, which no sensor can have measured.
            _ => Status::Range as u8,
        });
        let Self { levels, mixed, statuses, .. } = self;
        if filter == EdgeFilter::DropMixed {
            levels.fill(codes.width, &codes.data, |d| d);
        }
        Isa::best().run(ClassifyPixels {
            frame,
            filter,
            statuses,
            mixed,
            tally,
            codes: &codes.data,
            plain: |code: u8| plain[code as usize],
            find_mixed: |row, mixed: &mut [u8]| mark_mixed_levels(levels, row, mixed),
        });
    }

    /// Classifies the pixels of 16-bit or float depth. `length` converts a stored value to a length,
    /// world units, NaN at holes.
    fn classify_lengths<C: Copy>(
        &mut self,
        frame: &Frame,
        depth: &Depth,
        codes: &Image<C>,
        length: impl Fn(C) -> f64,
        filter: EdgeFilter,
        tally: &mut [usize; 5],
    ) {
        let focal = frame.camera.intrinsics.fx as f32;
        let Self { lengths, mixed, statuses, .. } = self;
        if filter == EdgeFilter::DropMixed {
            // NaN at holes becomes 0, which `mark_mixed_lengths` excludes.
            lengths.fill(codes.width, &codes.data, |code| length(code).max(0.0) as f32);
        }
        Isa::best().run(ClassifyPixels {
            frame,
            filter,
            statuses,
            mixed,
            tally,
            codes: &codes.data,
            plain: |code| {
                // NaN is outside every interval: without branches the row vectorises.
                let length = length(code);
                let [near, far] = depth.trusted;
                let is_kept = (length > near) & (length < far);
                let measured = if is_kept { Status::Kept as u8 } else { Status::Range as u8 };
                if length.is_nan() { Status::Hole as u8 } else { measured }
            },
            find_mixed: |row, mixed: &mut [u8]| {
                mark_mixed_lengths(lengths, row, focal, depth.units_per_metre as f32, mixed);
            },
        });
    }

    fn emit<C: Copy + Default>(
        &mut self,
        frame: &Frame,
        kind: DepthKind,
        settings: &UnprojectSettings,
        out: &mut Points<f32>,
        codes: &[C],
        length: impl Fn(C) -> f64,
    ) {
        let k = &frame.camera.intrinsics;
        let rule = RayRule::new(k, settings.convention);
        let (width, height) = (frame.color.width, frame.color.height);
        // Padded to whole tiles like the statuses, so that tiles at the border need no special case.
        self.columns.fill(width.next_multiple_of(TILE), |column| rule.column(column));
        self.rows.clear();
        self.rows.extend((0..height.next_multiple_of(TILE)).map(|row| rule.row(row)));
        let kept = self.statuses.iter().filter(|status| **status == Status::Kept as u8).count();
        out.reserve(kept, self.statuses.len() / (TILE * TILE));
        let normalization = &settings.normalization;
        // The scale of every axis is merged into the rotation: world to model in one product.
        let per_unit = DVec3::ONE / DVec3::from_array(normalization.scale);
        let rotation = DMat3::from_diagonal(per_unit) * frame.camera.pose.rotation();
        let origin = normalization.normalize(frame.camera.pose.centre()).to_array();
        Isa::best().run(Emission {
            statuses: &self.statuses,
            columns: &self.columns,
            rows: &self.rows,
            width,
            codes,
            length,
            kind,
            colors: &frame.color.data,
            channel: &std::array::from_fn(|byte| {
                Normalization::normalize_channel(byte as f64 / 255.0) as f32
            }),
            placement: Placement { axes: rotation.to_cols_array_2d(), origin },
            farthest: MAX_COORDINATE,
            out,
        });
    }
}

/// First pass over an image: classifies every pixel, row by row.
struct ClassifyPixels<'a, C, P, M> {
    frame: &'a Frame,
    filter: EdgeFilter,
    statuses: &'a mut Vec<u8>,
    mixed: &'a mut Vec<u8>,
    tally: &'a mut [usize; 5],
    codes: &'a [C],
    plain: P,
    /// Writes 1 for each pixel of a row that mixes two surfaces, else 0.
    find_mixed: M,
}

impl<C: Copy, P: Fn(C) -> u8, M: Fn(usize, &mut [u8])> Kernel for ClassifyPixels<'_, C, P, M> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { frame, statuses, mixed, .. } = self;
        let (width, height) = (frame.color.width, frame.color.height);
        let stride = width.next_multiple_of(TILE);
        statuses.clear();
        statuses.resize(stride * height.next_multiple_of(TILE), Status::Hole as u8);
        mixed.clear();
        mixed.resize(width, 0);
        for row in 0..height {
            let pixels = row * width..(row + 1) * width;
            let line = &mut statuses[row * stride..row * stride + width];
            for (status, code) in line.iter_mut().zip(&self.codes[pixels.clone()]) {
                *status = (self.plain)(*code);
            }
            if self.filter == EdgeFilter::DropMixed {
                (self.find_mixed)(row, mixed);
                drop_mixed(line, &frame.color.data[pixels], mixed);
            }
            // One pass per status while the row is in the cache; a histogram would not vectorise.
            for (status, n) in self.tally.iter_mut().enumerate() {
                *n += line.iter().filter(|found| usize::from(**found) == status).count();
            }
        }
    }
}

/// Marks measured pixels of a row as dropped if they are transparent or mix two surfaces. Transparency
/// takes precedence, because it often causes the mixing.
#[inline(always)]
fn drop_mixed(line: &mut [u8], colors: &[[u8; 4]], mixed: &[u8]) {
    for ((status, color), mixed) in line.iter_mut().zip(colors).zip(mixed) {
        let edge = if *mixed != 0 { Status::Edge as u8 } else { *status };
        let measured = if color[3] != u8::MAX { Status::Alpha as u8 } else { edge };
        // A hole was not measured, so nothing is dropped there.
        *status = if *status == Status::Hole as u8 { *status } else { measured };
    }
}

/// Minimum depth difference between opposite neighbours of a mixed pixel. Its unit is a step of 8-bit
/// codes, or the noise half-width of lengths.
const JUMP: u8 = 6;
/// Minimum depth difference of a mixed pixel from both neighbours, in the units of [`JUMP`].
const MARGIN: u8 = 2;
/// Depth difference between opposite diagonal neighbours on a plane tilted by 80°, in pixel widths:
/// `2·√2·tan 80°`.
const STEEPEST_PLANE: f32 = 16.0;

/// Image with a replicated border of one pixel; its memory is reused between frames.
#[derive(Clone, Debug, Default)]
pub(super) struct Padded<T> {
    values: Vec<T>,
    stride: usize,
}

impl<T: Copy> Padded<T> {
    pub fn fill<S: Copy>(&mut self, width: usize, data: &[S], mut convert: impl FnMut(S) -> T) {
        self.values.clear();
        self.stride = width + 2;
        if width == 0 {
            return;
        }
        let height = data.len() / width;
        self.values.reserve((height + 2) * self.stride);
        // First and last row twice: at a border a pixel is its own neighbour and not an edge.
        for row in (0..height).take(1).chain(0..height).chain((0..height).last()) {
            let source = &data[row * width..(row + 1) * width];
            self.values.push(convert(source[0]));
            self.values.extend(source.iter().map(|v| convert(*v)));
            self.values.push(convert(source[width - 1]));
        }
    }

    fn padded_rows(&self, row: usize) -> [&[T]; 3] {
        let at = |i: usize| &self.values[(row + i) * self.stride..(row + i + 1) * self.stride];
        [at(0), at(1), at(2)]
    }
}

#[inline(always)]
pub(super) fn mark_mixed_levels(image: &Padded<u8>, row: usize, mixed: &mut [u8]) {
    mark_between_opposite(image, row, mixed, |a, d, b| {
        let (low, high) = (a.min(b), a.max(b));
        // `&` instead of `&&`: without branches the row vectorises.
        (high - low >= JUMP)
            & (d >= low.saturating_add(MARGIN))
            & (d <= high.saturating_sub(MARGIN))
    });
}

/// Writes 1 for each pixel of a row of lengths that mixes two surfaces, else 0. Lengths are in world
/// units (0 at holes), `metre` in world units per metre, `focal` in pixels.
#[inline(always)]
pub(super) fn mark_mixed_lengths(
    image: &Padded<f32>,
    row: usize,
    focal: f32,
    metre: f32,
    mixed: &mut [u8],
) {
    let per_metre = 1.0 / metre;
    let per_depth = STEEPEST_PLANE / focal;
    mark_between_opposite(image, row, mixed, |a, d, b| {
        let q = metre * sensor_noise(d * per_metre);
        // The step of a steep plane is not an edge: without this exception, 12 % of a demo frame were
        // dropped.
        let jump = (f32::from(JUMP) * q).max(per_depth * d);
        let (low, high) = (a.min(b), a.max(b));
        let margin = f32::from(MARGIN) * q;
        // `low > 0`: a hole beside the pixel is not a surface.
        (low > 0.0) & (high - low >= jump) & (d >= low + margin) & (d <= high - margin)
    });
}

/// Writes 1 for each pixel of a row that is between two opposite neighbours according to `is_between`,
/// else 0. Iterates over slices of equal length, which the compiler vectorises.
#[inline(always)]
fn mark_between_opposite<T: Copy>(
    image: &Padded<T>,
    row: usize,
    mixed: &mut [u8],
    is_between: impl Fn(T, T, T) -> bool,
) {
    let width = mixed.len();
    let [above, here, below] = image.padded_rows(row);
    let (al, ac, ar) = (&above[..width], &above[1..=width], &above[2..width + 2]);
    let (hl, hc, hr) = (&here[..width], &here[1..=width], &here[2..width + 2]);
    let (bl, bc, br) = (&below[..width], &below[1..=width], &below[2..width + 2]);
    for x in 0..width {
        let d = hc[x];
        let any = is_between(hl[x], d, hr[x])
            | is_between(ac[x], d, bc[x])
            | is_between(al[x], d, br[x])
            | is_between(ar[x], d, bl[x]);
        mixed[x] = u8::from(any);
    }
}

#[cfg(test)]
mod edges_tests {
    use super::*;

    fn middle<T: Copy>(image: [T; 9], judge: impl Fn(&Padded<T>, &mut [u8])) -> bool {
        let mut padded = Padded { values: Vec::new(), stride: 0 };
        padded.fill(3, &image, |v| v);
        let mut mixed = [0; 3];
        judge(&padded, &mut mixed);
        mixed[1] == 1
    }

    #[test]
    fn levels_between_a_jump_are_mixed() {
        for (a, d, b, is_mixed) in [
            (100, 103, 106, true),
            (100, 102, 106, true),
            (100, 101, 106, false),
            (100, 104, 106, true),
            (100, 105, 106, false),
            (100, 102, 105, false),
            (106, 103, 100, true),
            (0, 90, 180, true),
            (0, 179, 180, false),
            (250, 255, 255, false),
        ] {
            let judge = |p: &Padded<u8>, m: &mut [u8]| mark_mixed_levels(p, 1, m);
            let turned = [
                [d, d, d, a, d, b, d, d, d],
                [d, a, d, d, d, d, d, b, d],
                [a, d, d, d, d, d, d, d, b],
                [d, d, b, d, d, d, a, d, d],
            ];
            for image in turned {
                assert_eq!(middle(image, judge), is_mixed, "{image:?}");
            }
        }
    }

    #[test]
    fn lengths_between_a_jump_are_mixed_unless_a_plane_or_a_hole_explains_them() {
        for (a, d, b, focal, is_mixed) in [
            (1.0, 1.05, 1.1, 585.0, true),
            (1.0, 1.004, 1.1, 585.0, false),
            (1.0, 1.05, 0.0, 585.0, false),
            (0.0, 1.05, 1.1, 585.0, false),
            (1.0, 1.008, 1.016, 585.0, false),
            // 30 mm over two pixels is an edge in a large image, a slant in a small one.
            (1.0, 1.015, 1.03, 585.0, true),
            (1.0, 1.015, 1.03, 120.0, false),
            // Noise grows with the square of the distance.
            (3.0, 3.05, 3.1, 585.0, false),
            (3.0, 3.2, 3.4, 585.0, true),
        ] {
            let judge = |p: &Padded<f32>, m: &mut [u8]| mark_mixed_lengths(p, 1, focal, 1.0, m);
            let image: [f32; 9] = [d, d, d, a, d, b, d, d, d];
            assert_eq!(middle(image, judge), is_mixed, "{image:?} at focal length {focal}");
        }
    }

    #[test]
    fn borders_are_replicated() {
        let mut padded = Padded { values: Vec::new(), stride: 0 };
        padded.fill(2, &[1u8, 2, 3, 4], |v| v);
        assert_eq!(padded.values, [1, 1, 2, 2, 1, 1, 2, 2, 3, 3, 4, 4, 3, 3, 4, 4]);
    }
}
