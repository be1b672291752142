//! What the rasteriser reads of a splat: one record for both renderers and both lenses.
//!
//! In the tangent frame of its centre every splat is a rational conic (`rendering.md`, Rational
//! conic). With `δ` the offset from the centre (pixels through a pinhole, direction cosines through
//! a fisheye) and `c` the share of the ray along the centre's direction (1 through a pinhole):
//!
//! ```text
//! N = p² + q²       p = p_x·δx + p_y·δy,  q = q_y·δy
//! f = c + ½ l·δ     the ray's part along the whitened line of sight
//! D² = N / (f² + w·N)     w = 1/D² at the camera
//! ```
//!
//! since `|g|²` is the sum of the squares along that line and across it. With `f` held above zero
//! the same formula gives `D² = 1/w` where the response is largest at the camera. The projected
//! renderer is the case `l = w = 0`. Every sum is one of squares: nothing cancels, and the error of
//! the numerator grows with `p`, where the expanded form's grows with `(p_x·δx)²`.

use crate::render::constants::TILE;
use std::ops::Range;

/// A splat in the image: one line of the cache, since rows fetch records from all over the list.
#[derive(Clone, Copy, Debug, Default)]
#[repr(align(64))]
pub(super) struct ConicRecord {
    /// Projected centre in pixels; not used by a fisheye.
    pub u: f32,
    pub v: f32,
    /// Factor of the numerator, scaled so that `alpha = opacity · 2^−D²`.
    pub p_x: f32,
    pub p_y: f32,
    pub q_y: f32,
    /// Per unit of `δ`: half the linear term `l` of the conic's denominator (exact), or what the depth of
    /// the splat's surface changes by (projected), world units.
    pub linear: [f32; 2],
    /// `w`, scaled so that `w·N` is what it was.
    pub w: f32,
    /// Smallest exponent of 2 that passes the alpha cut, and that `exp2` can take.
    pub cut: f32,
    pub opacity: f32,
    pub color: [f32; 3],
    /// Depth of the centre along the ray `(x, y, 1)` (pinhole) or a unit ray (fisheye).
    pub reach: f32,
    pub rect: Rect,
}

/// Change of colour over a splat, one of each per channel: `(τ − 1)·along + τ·(across·δ)`
/// (`rendering.md`, Native appearance).
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Gradient {
    pub along: [f32; 3],
    pub across: [[f32; 2]; 3],
}

/// Orthonormal frame of a splat seen through a fisheye: camera axes.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct TangentFrame {
    /// Rows: the two axes of `δ`, then the direction of the centre.
    pub rows: [[f32; 3]; 3],
}

/// Pixels `x0..x1` × `y0..y1`; not empty in a visible record.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Rect {
    pub x0: u16,
    pub x1: u16,
    pub y0: u16,
    pub y1: u16,
}

impl Rect {
    /// Columns of tiles it touches.
    pub(super) fn tile_columns(&self) -> Range<usize> {
        tiles(self.x0, self.x1)
    }

    /// Rows of tiles it touches.
    #[cfg(feature = "gui")]
    pub(super) fn tile_rows(&self) -> Range<usize> {
        tiles(self.y0, self.y1)
    }
}

/// Tiles that pixels `lo..hi` lie in.
fn tiles(lo: u16, hi: u16) -> Range<usize> {
    lo as usize / TILE..(hi as usize).div_ceil(TILE)
}

/// What sorting and listing by row need of a record, by itself.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct DepthEntry {
    /// View depth (projected) or distance (exact); positive, so its bits order like its value.
    pub key: f32,
    y0: u16,
    y1: u16,
}

impl DepthEntry {
    pub(super) fn new(key: f32, rect: &Rect) -> Self {
        Self { key, y0: rect.y0, y1: rect.y1 }
    }

    /// Rows of tiles that the record touches.
    pub(super) fn tile_rows(&self) -> Range<usize> {
        tiles(self.y0, self.y1)
    }
}

/// The records of one view. `gradients` and `frames` have as many entries where the view needs
/// them, else none.
#[derive(Default)]
pub(super) struct Records {
    pub records: Vec<ConicRecord>,
    /// Number of each record's splat.
    pub ids: Vec<u32>,
    pub gradients: Vec<Gradient>,
    pub frames: Vec<TangentFrame>,
}

impl Records {
    /// Becomes the listed entries of `all`, in that order, without the numbers of their splats.
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
