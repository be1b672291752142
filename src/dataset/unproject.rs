//! Frames to coloured points for the published algorithm: unprojection (`dataset.md`, Unprojection), validity,
//! tile order (`dataset.md`, Tile order).
//!
//! Two passes over the image. The first gives every pixel a status, row by row in vector code: a
//! hole, kept, or why it is dropped. The second visits the kept ones in tiles of 8×8 pixels, made
//! of quads of 4×4, and makes points: sums of the mixture are formed tile by tile, whatever thread
//! takes a tile, so their bits depend on the tiles alone.
//!
//! Two rules of the published loader are options, not corrected in silence, because its figures
//! depend on them: rays through pixel corners with a small-angle formula
//! ([`CameraConvention::Paper`]), and no filter of flying pixels ([`EdgeFilter::Off`]). Rays are
//! rotated and scaled in f64; only the point is rounded.

use super::depth::{Depth, DepthCodes, DepthKind, decode_inverse8, decode_length, decode_linear16};
use super::edges::{Padded, mixed_lengths, mixed_levels};
use super::error::FrameError;
use super::frame::Frame;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::normalization::Normalization;
use crate::observation::points::Points;
use glam::{DMat3, DVec3};

/// Points farther out than this (normalised) are dropped: nothing sane lies there and `f32` would
/// resolve it to 0.008 only.
pub const MAX_COORDINATE: f32 = 65536.0;

/// How pixels become rays.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraConvention {
    /// The published loader: rays through pixel corners, and a small-angle formula with `h − 1`
    /// from ray distance to depth (`dataset.md`, Unprojection).
    Paper,
    /// Rays through pixel centres, exact.
    Exact,
}

/// Whether pixels that mix two surfaces are dropped.
#[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum EdgeFilter {
    /// Every pixel with depth is a point, whatever its alpha.
    Off,
    /// Pixels of partial alpha, and pixels between two surfaces, are dropped (`dataset.md`, Edge
    /// filter).
    DropMixed,
}

/// What became of the pixels of one frame; the fields add up to width × height.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PointCounts {
    /// Pixels that became points.
    pub kept: usize,
    /// Pixels at which no surface was measured.
    pub holes: usize,
    /// Measured pixels whose colour is partially transparent.
    pub dropped_alpha: usize,
    /// Measured pixels that mix two surfaces.
    pub dropped_edge: usize,
    /// Measured pixels outside the trusted depth.
    pub dropped_range: usize,
    /// Measured pixels whose point is not finite or lies beyond [`MAX_COORDINATE`].
    pub dropped_far: usize,
}

/// In words, without those that made points.
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
    /// Measured pixels that made no point.
    pub fn dropped(&self) -> usize {
        self.dropped_alpha + self.dropped_edge + self.dropped_range + self.dropped_far
    }
}

/// What to make of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct UnprojectSettings {
    /// How pixels become rays.
    pub convention: CameraConvention,
    /// Whether mixed pixels are dropped.
    pub filter: EdgeFilter,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// Camera-space point (OpenCV axes, world units) of the pixel `[column, row]` at length `value` of
/// `kind` (`dataset.md`, Unprojection); `paper` half-widths are those of the image's width.
pub fn camera_point(
    k: &Intrinsics,
    convention: CameraConvention,
    kind: DepthKind,
    [column, row]: [usize; 2],
    value: f64,
) -> DVec3 {
    let rule = RayRule::new(k, convention);
    local_point(rule.column(column), rule.row(row), kind, value)
}

/// Slope of a ray against the optical axis in one image direction, and what it adds to the squared
/// ray length per unit of depth.
#[derive(Clone, Copy, Debug)]
struct Slope {
    tangent: f64,
    stretch: f64,
}

struct RayRule<'a> {
    k: &'a Intrinsics,
    /// Pixel index to pixel coordinate.
    shift: f64,
    /// Factor of the paper's small-angle stretch, `(θ/2)/(h − 1)` per pixel.
    small_angle: Option<f64>,
}

impl<'a> RayRule<'a> {
    fn new(k: &'a Intrinsics, convention: CameraConvention) -> Self {
        match convention {
            CameraConvention::Exact => Self { k, shift: 0.5, small_angle: None },
            CameraConvention::Paper => {
                // The published formula takes the width for both axes and one pixel off its half.
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

#[inline(always)]
fn local_point(x: Slope, y: Slope, kind: DepthKind, value: f64) -> DVec3 {
    let z = match kind {
        DepthKind::RayDistance => value / (1.0 + x.stretch + y.stretch).sqrt(),
        DepthKind::Z => value,
    };
    DVec3::new(x.tangent * z, y.tangent * z, z)
}

/// Turns frames into points; keeps its scratch memory between frames.
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
    /// One [`Status`] per pixel, rows and columns padded to whole tiles with holes.
    statuses: Vec<u8>,
    columns: Vec<Slope>,
}

/// Whether a pixel becomes a point, or why it does not.
#[derive(Clone, Copy)]
#[repr(u8)]
enum Status {
    Hole,
    Kept,
    Alpha,
    Edge,
    Range,
}

/// Pixels on a side of a tile.
const TILE: usize = 8;
/// Pixels on a side of a quad.
const QUAD: usize = 4;

impl Unprojector {
    /// No memory yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Replaces `out` by the normalised points of the frame: one tile per 8×8 pixels, rows of tiles
    /// from the top; in a tile four 4×4 quads, in a quad rows of 4.
    pub fn unproject(
        &mut self,
        frame: &Frame,
        settings: &UnprojectSettings,
        out: &mut Points<f32>,
    ) -> Result<PointCounts, FrameError> {
        out.clear();
        let registered = frame.registered();
        let frame = registered.as_ref();
        let depth = frame.depth_to_use()?;
        let mut tally = [0usize; 5];
        match &depth.codes {
            DepthCodes::Inverse8(codes) => {
                self.judge_levels(frame, depth, codes, settings.filter, &mut tally);
                // Holes get 0, which is never read: they are not kept.
                let lengths: [f64; 256] =
                    std::array::from_fn(|d| decode_inverse8(d as u8).unwrap_or(0.0));
                self.emit(frame, depth.kind, settings, out, |i| lengths[codes.data[i] as usize]);
            }
            DepthCodes::Linear16 { codes, unit } => {
                let length = |code: u16| decode_linear16(code, *unit);
                self.judge_lengths(frame, depth, codes, length, settings.filter, &mut tally);
                self.emit(frame, depth.kind, settings, out, |i| f64::from(codes.data[i]) * unit);
            }
            DepthCodes::Lengths(lengths) => {
                let filter = settings.filter;
                self.judge_lengths(frame, depth, lengths, decode_length, filter, &mut tally);
                self.emit(frame, depth.kind, settings, out, |i| f64::from(lengths.data[i]));
            }
        }
        // Only the point itself tells that it is too far, after its status was decided.
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

    fn judge_levels(
        &mut self,
        frame: &Frame,
        depth: &Depth,
        codes: &Image<u8>,
        filter: EdgeFilter,
        tally: &mut [usize; 5],
    ) {
        let plain: [Status; 256] = std::array::from_fn(|d| match (d, decode_inverse8(d as u8)) {
            (0, _) => Status::Hole,
            (_, Some(length)) if depth.trusts(length) => Status::Kept,
            // Code 255 among them: the camera's own centre, which no sensor can have measured.
            _ => Status::Range,
        });
        let Self { levels, mixed, statuses, .. } = self;
        if filter == EdgeFilter::DropMixed {
            levels.fill(codes.width, &codes.data, |d| d);
        }
        judge_rows(
            frame,
            filter,
            statuses,
            mixed,
            tally,
            |row, mixed| {
                mixed_levels(levels, row, mixed);
            },
            |i| plain[codes.data[i] as usize],
        );
    }

    /// `length` is that of a code, `None` at holes.
    fn judge_lengths<C: Copy>(
        &mut self,
        frame: &Frame,
        depth: &Depth,
        codes: &Image<C>,
        length: impl Fn(C) -> Option<f64>,
        filter: EdgeFilter,
        tally: &mut [usize; 5],
    ) {
        let focal = frame.camera.intrinsics.fx as f32;
        let Self { lengths, mixed, statuses, .. } = self;
        if filter == EdgeFilter::DropMixed {
            lengths.fill(codes.width, &codes.data, |code| length(code).unwrap_or(0.0) as f32);
        }
        let plain = |i: usize| match length(codes.data[i]) {
            None => Status::Hole,
            Some(length) if depth.trusts(length) => Status::Kept,
            Some(_) => Status::Range,
        };
        judge_rows(
            frame,
            filter,
            statuses,
            mixed,
            tally,
            |row, mixed| {
                mixed_lengths(lengths, row, focal, depth.metre as f32, mixed);
            },
            plain,
        );
    }

    fn emit(
        &mut self,
        frame: &Frame,
        kind: DepthKind,
        settings: &UnprojectSettings,
        out: &mut Points<f32>,
        length: impl Fn(usize) -> f64,
    ) {
        let k = &frame.camera.intrinsics;
        let rule = RayRule::new(k, settings.convention);
        let (width, height) = (frame.color.width, frame.color.height);
        self.columns.clear();
        self.columns.extend((0..width).map(|column| rule.column(column)));
        let normalization = &settings.normalization;
        // The scale of every axis is taken into the rotation: world to model in one product.
        let per_unit = DVec3::ONE / DVec3::from_array(normalization.scale);
        let rotation = DMat3::from_diagonal(per_unit) * frame.camera.pose.rotation();
        let origin = normalization.normalize(frame.camera.pose.centre());
        let channel: [f32; 256] = std::array::from_fn(|byte| {
            Normalization::normalize_channel(byte as f64 / 255.0) as f32
        });
        let stride = width.next_multiple_of(TILE);
        for tile_row in (0..height).step_by(TILE) {
            for tile_column in (0..stride).step_by(TILE) {
                for [dx, dy] in TILE_ROWS {
                    let (column, row) = (tile_column + dx, tile_row + dy);
                    let at = row * stride + column;
                    let four = &self.statuses[at..at + QUAD];
                    // Rows of four without a point are passed over before a ray is formed.
                    if !four.contains(&(Status::Kept as u8)) {
                        continue;
                    }
                    let slope_y = rule.row(row);
                    for (column, status) in (column..).zip(four) {
                        if *status != Status::Kept as u8 {
                            continue;
                        }
                        let i = row * width + column;
                        let local = local_point(self.columns[column], slope_y, kind, length(i));
                        let p = (rotation * local + origin).as_vec3();
                        let [r, g, b, _] = frame.color.data[i].map(|c| channel[c as usize]);
                        // What the largest element beside a NaN is depends on the machine.
                        if p.abs().max_element() <= MAX_COORDINATE && !p.is_nan() {
                            out.push([p.x, p.y, p.z, r, g, b]);
                        }
                    }
                }
                out.close_tile();
            }
        }
    }
}

/// Offsets of the rows of four in a tile, in order.
const TILE_ROWS: [[usize; 2]; 16] = {
    let mut rows = [[0; 2]; 16];
    let mut i = 0;
    while i < 16 {
        let (quad, line) = (i / QUAD, i % QUAD);
        rows[i] = [quad % 2 * QUAD, quad / 2 * QUAD + line];
        i += 1;
    }
    rows
};

/// Decides the status of every pixel, row by row.
fn judge_rows(
    frame: &Frame,
    filter: EdgeFilter,
    statuses: &mut Vec<u8>,
    mixed: &mut Vec<u8>,
    tally: &mut [usize; 5],
    find_mixed: impl Fn(usize, &mut [u8]),
    plain: impl Fn(usize) -> Status,
) {
    let (width, height) = (frame.color.width, frame.color.height);
    let stride = width.next_multiple_of(TILE);
    statuses.clear();
    statuses.resize(stride * height.next_multiple_of(TILE), Status::Hole as u8);
    mixed.clear();
    mixed.resize(width, 0);
    for row in 0..height {
        if filter == EdgeFilter::DropMixed {
            find_mixed(row, mixed);
        }
        let colors = &frame.color.data[row * width..(row + 1) * width];
        let line = &mut statuses[row * stride..row * stride + width];
        for (column, status) in line.iter_mut().enumerate() {
            // One status a pixel: transparency is asked before edges, since it often makes them.
            let judged = match (plain(row * width + column), filter) {
                (Status::Hole, _) => Status::Hole,
                (other, EdgeFilter::Off) => other,
                (_, EdgeFilter::DropMixed) if colors[column][3] != 255 => Status::Alpha,
                (_, EdgeFilter::DropMixed) if mixed[column] != 0 => Status::Edge,
                (other, EdgeFilter::DropMixed) => other,
            };
            *status = judged as u8;
            tally[judged as usize] += 1;
        }
    }
}
