//! Converts classified pixels to points, tile by tile: tiles of 8×8 pixels, made of quads of 4×4. The
//! mixture's sums are formed per tile, so they are bitwise independent of the assignment of tiles to
//! threads.
//!
//! The four pixels of a row of a quad are one SIMD step. Dropped pixels among them are computed but not
//! stored. A tile's points are gathered on the stack: pushing them one by one to six vectors took as long
//! as all the arithmetic. Every operation rounds as for a single point, so the result is bitwise that of
//! processing pixel by pixel.

use super::depth::DepthKind;
use crate::math::simd::{Kernel, Vector};
use crate::observation::points::Points;

pub(super) const TILE: usize = 8;
const QUAD: usize = 4;

/// Column and row offsets of each row of four pixels within a tile, in processing order.
const TILE_ROWS: [[usize; 2]; 16] = {
    let mut rows = [[0; 2]; 16];
    let mut i = 0;
    // Constants cannot use `for`.
    while i < 16 {
        let (quad, line) = (i / QUAD, i % QUAD);
        rows[i] = [quad % 2 * QUAD, quad / 2 * QUAD + line];
        i += 1;
    }
    rows
};

/// Classification of a pixel: kept as a point, or the reason why it is dropped.
#[derive(Clone, Copy)]
#[repr(u8)]
pub(super) enum Status {
    Hole,
    Kept,
    Alpha,
    Edge,
    Range,
}

/// Ray slopes (offset per unit of depth) of pixels along one image axis. A stretch is the contribution
/// of a slope to the squared ray length per unit of depth.
#[derive(Clone, Debug, Default)]
pub(super) struct Slopes {
    pub tangents: Vec<f64>,
    pub stretches: Vec<f64>,
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Slope {
    pub tangent: f64,
    pub stretch: f64,
}

pub(super) struct Placement {
    pub axes: [[f64; 3]; 3],
    pub origin: [f64; 3],
}

/// Second pass over an image: converts kept pixels to points.
pub(super) struct Emission<'a, C, L> {
    /// One [`Status`] per pixel; rows and columns are padded to whole tiles with [`Status::Hole`].
    pub statuses: &'a [u8],
    pub columns: &'a Slopes,
    pub rows: &'a [Slope],
    pub width: usize,
    pub codes: &'a [C],
    /// Converts a code to a length, world units; the result for a hole is not used.
    pub length: L,
    pub kind: DepthKind,
    pub colors: &'a [[u8; 4]],
    pub channel: &'a [f32; 256],
    pub placement: Placement,
    pub farthest: f32,
    pub out: &'a mut Points<f32>,
}

/// Points of the current tile, in columns: x, y, z, red, green, blue.
struct TileBuffer {
    columns: [[f32; TILE * TILE]; 6],
    n: usize,
}

/// Returns camera-space coordinates x, y and z (OpenCV axes, world units) of `N` pixels of one row. The
/// pixels are given by the slopes of their columns and by their lengths measured along `kind`.
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
                    // Rows of four without a point are skipped before their rays are computed.
                    let kept = four.map(|status| status == Status::Kept as u8);
                    if kept != [false; QUAD] {
                        self.emit_four(column, row, kept, &mut tile);
                    }
                }
                self.out.push_tile(tile.columns.each_ref().map(|column| &column[..tile.n]));
            }
        }
    }
}

impl<C: Copy + Default, L: Fn(C) -> f64> Emission<'_, C, L> {
    /// Converts the kept pixels among four in a row and adds them to the tile. At least one of them is
    /// kept.
    #[inline(always)]
    fn emit_four(&self, column: usize, row: usize, kept: [bool; QUAD], tile: &mut TileBuffer) {
        let at = row * self.width + column;
        let is_whole = kept == [true; QUAD];
        let (codes, colors) = match is_whole {
            true => (first_four(&self.codes[at..]), first_four(&self.colors[at..])),
            // Dropped pixels are not read: after the last column the next image row begins, or the
            // buffer ends.
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
            slopes.map(|slopes| first_four(&slopes[column..])),
            self.rows[row],
            self.kind,
            codes.map(&self.length),
        );
        let points = self.placement.points(local);
        let channel = |k: usize| colors.map(|color| self.channel[color[k] as usize]);
        let [x, y, z] = points;
        let columns = [x, y, z, channel(0), channel(1), channel(2)];
        // False for NaN as well.
        let is_near = |p: &f32| p.abs() <= self.farthest;
        // `fold` instead of `all`: without an early exit the twelve tests have no branches.
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

#[inline(always)]
fn first_four<T: Copy>(values: &[T]) -> [T; QUAD] {
    // One bounds check for all four.
    let four = &values[..QUAD];
    std::array::from_fn(|j| four[j])
}
