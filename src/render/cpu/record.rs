//! Record of a splat for the rasteriser, common to both renderers and both lenses.
//!
//! In the tangent plane of its centre every splat is a rational conic (`rendering.md`, Rational
//! conic). `δ` is the offset from the centre (pixels for a pinhole, direction cosines for a
//! fisheye). `c` is the ray's component along the centre's direction (1 for a pinhole):
//!
//! ```text
//! N = p² + q²       p = p_x·δx + p_y·δy,  q = q_y·δy
//! f = c + ½ l·δ     the ray's part along the whitened line of sight
//! D² = N / (f² + w·N)     w = 1/D² at the camera
//! ```
//!
//! The squared length of the whitened ray is the sum of the squares of its components along this line and
//! across it. With `f` clamped to be non-negative, the formula gives `D² = 1/w` where the response is largest
//! at the camera. The projected renderer is the case `l = w = 0`. All sums are sums of squares, so nothing
//! cancels. The error of the numerator grows with `p`; in the expanded form it would grow with `(p_x·δx)²`.

use super::textures::SurfacePlane;
use crate::render::options::TILE;
use std::ops::Range;

/// Projected splat. Fits one cache line, because rows fetch records from all over the list.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct ConicRecord {
    /// Projected centre in pixels; unused with a fisheye.
    pub u: f32,
    pub v: f32,
    /// Coefficients of the numerator `N`, scaled so that `alpha = opacity · 2^−D²`.
    pub p_x: f32,
    pub p_y: f32,
    pub q_y: f32,
    /// Exact renderer: half the linear term `l` of the conic's denominator, per unit of `δ`. Projected
    /// renderer: depth change of the splat's surface per px, world units.
    pub linear: [f32; 2],
    /// Coefficient `w` of the denominator, scaled inversely to `N`, so that `w·N` is unchanged.
    pub w: f32,
    /// Smallest exponent of 2 that passes the alpha cut and that `exp2` supports.
    pub min_exponent: f32,
    pub opacity: f32,
    pub color: [f32; 3],
    /// Depth of the centre along the ray `(x, y, 1)` (pinhole) or distance along a unit ray (fisheye).
    pub reach: f32,
    // 16 bits per side, so that the record fills exactly 64 bytes.
    pub rect: Rect,
}

/// Colour gradient over a splat. At the offset `δ`, each channel changes by
/// `(τ − 1)·along + τ·(across·δ)`. `τ` is the position of the largest response on the ray
/// (`rendering.md`, Native appearance).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gradient {
    pub along: [f32; 3],
    pub across: [[f32; 2]; 3],
}

/// Orthonormal frame of a splat seen through a fisheye, in camera axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TangentFrame {
    /// Rows: the two axes of `δ`, then the direction of the centre.
    pub rows: [[f32; 3]; 3],
}

/// Pixel rectangle `x0..x1` × `y0..y1`; not empty in a visible record.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rect {
    pub x0: u16,
    pub x1: u16,
    pub y0: u16,
    pub y1: u16,
}

impl Rect {
    pub(super) fn tile_columns(&self) -> Range<usize> {
        tile_range(self.x0, self.x1)
    }

    /// Returns those of the tiles `columns` that the rectangle touches, numbered from the first of them.
    #[inline(always)]
    pub(super) fn columns_within(&self, columns: &Range<usize>) -> Range<usize> {
        let Range { start, end } = self.tile_columns();
        let within = |column: usize| column.clamp(columns.start, columns.end) - columns.start;
        within(start)..within(end)
    }

    #[cfg(feature = "gui")]
    pub(super) fn tile_rows(&self) -> Range<usize> {
        tile_range(self.y0, self.y1)
    }
}

/// Returns the range of tiles that contain the pixels `lo..hi`.
fn tile_range(lo: u16, hi: u16) -> Range<usize> {
    lo as usize / TILE..(hi as usize).div_ceil(TILE)
}

/// Sort key and pixel rows of a record. Stored separately, because sorting and listing read nothing
/// else.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DepthEntry {
    /// View depth (projected renderer) or distance (exact renderer) of the centre. Positive, so that
    /// the bits have the same order as the values.
    pub key: f32,
    y0: u16,
    y1: u16,
}

impl DepthEntry {
    pub(super) fn new(key: f32, rect: &Rect) -> Self {
        Self { key, y0: rect.y0, y1: rect.y1 }
    }

    pub(super) fn tile_rows(&self) -> Range<usize> {
        tile_range(self.y0, self.y1)
    }
}

/// Records of one view. `gradients` and `frames` have one entry per record if the view needs them,
/// otherwise none.
#[derive(Default)]
pub(super) struct Records {
    pub records: Vec<ConicRecord>,
    /// Splat index of each record.
    pub ids: Vec<u32>,
    pub gradients: Vec<Gradient>,
    pub frames: Vec<TangentFrame>,
    /// Planes of textured splats; not gathered.
    pub planes: Vec<SurfacePlane>,
}

impl Records {
    /// Replaces the contents with the listed entries of `all`, in the order of `list`; leaves `ids`
    /// unchanged.
    pub(super) fn gather(&mut self, all: &Self, list: &[u32]) {
        fn pick<T: Copy>(to: &mut Vec<T>, from: &[T], list: &[u32]) {
            to.clear();
            if !from.is_empty() {
                to.extend(list.iter().map(|&i| from[i as usize]));
            }
        }
        pick(&mut self.records, &all.records, list);
        pick(&mut self.gradients, &all.gradients, list);
        pick(&mut self.frames, &all.frames, list);
    }
}
