//! One row of tiles: drawn, then compared with the photograph.

use super::super::raster::{BATCH, Batch};
use super::super::record::Records;
use super::super::tile::{Form, Tile};
use super::sums::{ImageSums, N_IMAGE_SUMS};
use super::walk::{PixelRule, SecondWalk};
use crate::math::image::Image;
use crate::math::simd::{Kernel, Vector};
use crate::render::constants::TILE;

/// Which rows of pixels are compared: every `every`-th, 1, 2, 4, 8 or 16 of them, from `first` on. Rows
/// and not tiles: of a splat that only some tiles may teach, they pull the whole.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowChoice {
    every: u32,
    first: u32,
}

impl RowChoice {
    /// At most so many: a tile has a row then.
    pub const MOST: u32 = TILE as u32;
    /// Every row.
    pub const ALL: Self = Self { every: 1, first: 0 };

    /// Every `every`-th row, of which the power of two below counts, 16 at most; the `turn`-th choice.
    pub fn new(every: u32, turn: u64) -> Self {
        let every = 1 << every.clamp(1, Self::MOST).ilog2();
        Self { every, first: (turn % u64::from(every)) as u32 }
    }

    /// Every how many rows one is compared.
    pub fn every(self) -> u32 {
        self.every
    }

    /// The first row that is compared.
    pub fn first(self) -> u32 {
        self.first
    }

    /// Rows of a tile, a bit each.
    fn mask(self) -> u32 {
        (self.first..Self::MOST).step_by(self.every as usize).fold(0, |mask, row| mask | 1 << row)
    }
}

/// What a row of tiles gives, and its buffers.
#[derive(Default)]
pub(super) struct WalkCanvas {
    /// Sums of each of the row's records, in the order of its list.
    pub sums: Vec<ImageSums>,
    /// Sum of squared differences over the channels of covered pixels.
    pub squared_error: f64,
    /// Covered pixels that count.
    pub pixels: f64,
    tiles: Vec<Tile>,
    batches: Vec<Batch>,
    walk: SecondWalk,
}

/// Compares one row of tiles with the photograph.
pub(super) struct WalkRow<'a> {
    pub records: &'a Records,
    /// Visible records of the row, nearest first.
    pub list: &'a [u32],
    pub row: usize,
    pub photograph: &'a Image<[f32; 4]>,
    pub rule: PixelRule,
    pub rows: RowChoice,
    pub canvas: &'a mut WalkCanvas,
}

impl Kernel for WalkRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { records, list, row, photograph, rule, rows, canvas } = self;
        canvas.begin(list.len());
        let mask = rows.mask();
        let (width, height, top) = (photograph.width, photograph.height, row * TILE);
        let n_tiles = width.div_ceil(TILE);
        canvas.tiles.resize_with(n_tiles, || Tile::new(0, 0, 0, 0));
        for (tile, left) in canvas.tiles.iter_mut().zip((0..width).step_by(TILE)) {
            tile.begin([left, top], [width - left, height - top], mask);
        }
        canvas.batches.resize_with(list.len().div_ceil(BATCH), Batch::default);
        for (batch, list) in canvas.batches.iter_mut().zip(list.chunks(BATCH)) {
            batch.fill(records, list, canvas.tiles.len());
            for (index, tile) in canvas.tiles.iter_mut().enumerate() {
                let (list, records) = (batch.by_tile.get(index), &batch.records);
                if records.gradients.is_empty() {
                    tile.blend_all::<V, { Form::PROJECTED }, false>(list, records, 1.0);
                } else {
                    tile.blend_all::<V, { Form::PROJECTED }, true>(list, records, 1.0);
                }
            }
        }
        for (index, tile) in canvas.tiles.iter().enumerate() {
            // Most tiles of an object before nothing show nothing.
            if canvas.batches.iter().all(|batch| batch.by_tile.get(index).is_empty()) {
                continue;
            }
            let walk = &mut canvas.walk;
            walk.begin(tile, photograph, rule, mask);
            let (error, pixels) = walk.error();
            canvas.squared_error += error;
            canvas.pixels += pixels;
            for (batch, sums) in canvas.batches.iter().zip(canvas.sums.chunks_mut(BATCH)) {
                walk.walk::<V>(batch.by_tile.get(index), &batch.records, sums);
            }
        }
    }
}

impl WalkCanvas {
    /// Forgets the last view.
    fn begin(&mut self, n_records: usize) {
        self.sums.clear();
        self.sums.resize(n_records, [0.0; N_IMAGE_SUMS]);
        (self.squared_error, self.pixels) = (0.0, 0.0);
    }
}
