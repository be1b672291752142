//! From judged pixels to points, tile by tile: 8×8 pixels made of quads of 4×4, because sums of the
//! mixture are formed tile by tile, so that their bits depend on the tiles alone and not on the thread
//! that takes one.
//!
//! The four pixels of a row of a quad are one step of vector code, most of which are kept or left as
//! one; what is not kept among them is computed and not stored. A tile's points are gathered on the
//! stack: six vectors that grow point by point took as long as all the arithmetic. Every operation is
//! rounded as it is for a point alone, so the bits are those of one pixel after another.

use super::depth::DepthKind;
use crate::math::simd::{Kernel, Vector};
use crate::observation::points::Points;

/// Pixels on a side of a tile.
pub(super) const TILE: usize = 8;
/// Pixels on a side of a quad.
const QUAD: usize = 4;

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

/// Whether a pixel becomes a point, or why it does not.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Status {
    Hole,
    Kept,
    Alpha,
    Edge,
    Range,
}

/// Slopes of the rays of some pixels against the optical axis in one image direction, and what they
/// add to the squared ray length per unit of depth.
#[derive(Clone, Debug, Default)]
pub(super) struct Slopes {
    pub tangents: Vec<f64>,
    pub stretches: Vec<f64>,
}

/// One of [`Slopes`].
#[derive(Clone, Copy, Debug)]
pub(super) struct Slope {
    pub tangent: f64,
    pub stretch: f64,
}

/// Camera space to model space.
pub(super) struct Placement {
    /// Columns of the matrix.
    pub axes: [[f64; 3]; 3],
    pub origin: [f64; 3],
}

/// The second pass over an image: its kept pixels become points.
pub(super) struct Emission<'a, C, L> {
    /// One [`Status`] a pixel, rows and columns padded to whole tiles with holes.
    pub statuses: &'a [u8],
    /// Of every column, padded as the statuses are.
    pub columns: &'a Slopes,
    /// Of every row, likewise.
    pub rows: &'a [Slope],
    pub width: usize,
    pub codes: &'a [C],
    /// Length of a code that is no hole.
    pub length: L,
    pub kind: DepthKind,
    pub colors: &'a [[u8; 4]],
    /// What a byte of a colour becomes.
    pub channel: &'a [f32; 256],
    pub placement: Placement,
    /// Largest coordinate that makes a point.
    pub farthest: f32,
    pub out: &'a mut Points<f32>,
}

/// Points of a tile that is being made: x, y, z, red, green, blue.
struct TileBuffer {
    columns: [[f32; TILE * TILE]; 6],
    n: usize,
}

/// Camera-space coordinates x, y and z (OpenCV axes, world units) of pixels of one row at lengths of
/// `kind`; their columns' tangents and stretches.
#[inline(always)]
pub(super) fn local_points<const N: usize>(
    [tangents, stretches]: [[f64; N]; 2],
    row: Slope,
    kind: DepthKind,
    lengths: [f64; N],
) -> [[f64; N]; 3] {
    let z: [f64; N] = match kind {
        DepthKind::RayDistance => {
            std::array::from_fn(|j| lengths[j] / (1.0 + stretches[j] + row.stretch).sqrt())
        }
        DepthKind::Z => lengths,
    };
    [std::array::from_fn(|j| tangents[j] * z[j]), z.map(|z| row.tangent * z), z]
}

impl Slopes {
    /// Replaces them by those of pixels 0 to `n`.
    pub fn fill(&mut self, n: usize, slope: impl Fn(usize) -> Slope) {
        self.tangents.clear();
        self.stretches.clear();
        self.tangents.extend((0..n).map(|i| slope(i).tangent));
        self.stretches.extend((0..n).map(|i| slope(i).stretch));
    }
}

impl<C: Copy + Default, L: Fn(C) -> f64> Kernel for Emission<'_, C, L> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let stride = self.columns.tangents.len();
        let mut tile = TileBuffer { columns: [[0.0; TILE * TILE]; 6], n: 0 };
        for tile_row in (0..self.rows.len()).step_by(TILE) {
            for tile_column in (0..stride).step_by(TILE) {
                tile.n = 0;
                for [dx, dy] in TILE_ROWS {
                    let (column, row) = (tile_column + dx, tile_row + dy);
                    let at = row * stride + column;
                    let four: [u8; QUAD] = std::array::from_fn(|j| self.statuses[at + j]);
                    // Rows of four without a point are passed over before a ray is formed.
                    let kept = four.map(|status| status == Status::Kept as u8);
                    if kept != [false; QUAD] {
                        self.four(column, row, kept, &mut tile);
                    }
                }
                self.out.push_tile(tile.columns.each_ref().map(|column| &column[..tile.n]));
            }
        }
    }
}

impl<C: Copy + Default, L: Fn(C) -> f64> Emission<'_, C, L> {
    /// A row of a quad, of which some are kept.
    #[inline(always)]
    fn four(&self, column: usize, row: usize, kept: [bool; QUAD], tile: &mut TileBuffer) {
        let at = row * self.width + column;
        let is_whole = kept == [true; QUAD];
        let (codes, colors) = match is_whole {
            true => (fixed(&self.codes[at..]), fixed(&self.colors[at..])),
            // Behind the last column the image's next row begins, or nothing: what is not kept is not read.
            false => {
                let if_kept = |j: usize| kept[j].then(|| at + j);
                (
                    std::array::from_fn(|j| if_kept(j).map_or(C::default(), |i| self.codes[i])),
                    std::array::from_fn(|j| if_kept(j).map_or([0; 4], |i| self.colors[i])),
                )
            }
        };
        let slopes = [&self.columns.tangents, &self.columns.stretches];
        let local = local_points(
            slopes.map(|slopes| fixed(&slopes[column..])),
            self.rows[row],
            self.kind,
            codes.map(&self.length),
        );
        let points = self.placement.points(local);
        let channel = |k: usize| colors.map(|color| self.channel[color[k] as usize]);
        let [x, y, z] = points;
        let columns = [x, y, z, channel(0), channel(1), channel(2)];
        // Not so of NaN either.
        let is_near = |p: &f32| p.abs() <= self.farthest;
        if is_whole && points.iter().flatten().fold(true, |all, p| all & is_near(p)) {
            tile.store_four(&columns);
            return;
        }
        for j in (0..QUAD).filter(|j| kept[*j]) {
            if points.iter().all(|axis| is_near(&axis[j])) {
                tile.store_one(&columns, j);
            }
        }
    }
}

impl Placement {
    /// Model-space coordinates of camera-space ones.
    #[inline(always)]
    fn points(&self, [x, y, z]: [[f64; QUAD]; 3]) -> [[f32; QUAD]; 3] {
        std::array::from_fn(|k| {
            let (axes, origin) = (&self.axes, self.origin[k]);
            std::array::from_fn(|j| {
                (axes[0][k] * x[j] + axes[1][k] * y[j] + axes[2][k] * z[j] + origin) as f32
            })
        })
    }
}

impl TileBuffer {
    #[inline(always)]
    fn store_four(&mut self, columns: &[[f32; QUAD]; 6]) {
        for (column, values) in self.columns.iter_mut().zip(columns) {
            column[self.n..self.n + QUAD].copy_from_slice(values);
        }
        self.n += QUAD;
    }

    #[inline(always)]
    fn store_one(&mut self, columns: &[[f32; QUAD]; 6], lane: usize) {
        for (column, values) in self.columns.iter_mut().zip(columns) {
            column[self.n] = values[lane];
        }
        self.n += 1;
    }
}

/// The first four.
#[inline(always)]
fn fixed<T: Copy>(values: &[T]) -> [T; QUAD] {
    let four = &values[..QUAD];
    std::array::from_fn(|j| four[j])
}
