//! Renders one row of tiles and compares it with the photograph.

use super::super::raster::{BATCH, Batch};
use super::super::record::Records;
use super::drawn::DrawnTile;
use super::sums::{ImageSums, N_IMAGE_SUMS};
use super::target::TargetTile;
use super::walk::{PixelRule, SecondWalk};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::simd::{Kernel, Vector};
use crate::render::constants::TILE;

/// Pixel rows to compare: every `every`-th row (1, 2, 4, 8 or 16), starting at `first`. Rows rather than
/// tiles, because a splat that is compared in only some of its tiles would be fitted to those alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowSubset {
    every: u32,
    first: u32,
}

impl RowSubset {
    /// Maximum of `every`: one row per tile remains.
    pub const MAX_STRIDE: u32 = TILE as u32;
    /// Every row.
    pub const ALL: Self = Self { every: 1, first: 0 };

    /// Chooses every `every`-th row, rounded down to a power of two of at most 16. `turn` cycles through
    /// the possible first rows.
    pub fn new(every: u32, turn: u64) -> Self {
        let every = 1 << every.clamp(1, Self::MAX_STRIDE).ilog2();
        Self { every, first: (turn % u64::from(every)) as u32 }
    }

    /// Distance between compared rows.
    pub fn stride(self) -> u32 {
        self.every
    }

    /// Index of the first compared row.
    pub fn first(self) -> u32 {
        self.first
    }

    /// One bit per compared row of a tile.
    fn mask(self) -> u32 {
        (self.first..Self::MAX_STRIDE)
            .step_by(self.every as usize)
            .fold(0, |mask, row| mask | 1 << row)
    }
}

/// Results and buffers of one row of tiles.
#[derive(Default)]
pub(super) struct WalkCanvas {
    /// Sums of the row's records, in list order.
    pub sums: Vec<ImageSums>,
    /// Sum of squared differences over the channels of covered pixels.
    pub squared_error: f64,
    /// Number of covered pixels.
    pub pixels: f64,
    batches: Vec<Batch>,
    target: TargetTile,
    drawn: DrawnTile,
    walk: SecondWalk,
}

/// Compares one row of tiles with the photograph.
pub(super) struct WalkRow<'a> {
    pub records: &'a Records,
    /// Visible records of the row, nearest first.
    pub list: &'a [u32],
    pub row: usize,
    pub photograph: &'a Image<MeasuredPixel>,
    pub rule: PixelRule,
    pub rows: RowSubset,
    pub canvas: &'a mut WalkCanvas,
}

impl Kernel for WalkRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { records, list, row, photograph, rule, rows, canvas } = self;
        canvas.reset(list.len());
        let (width, height, top) = (photograph.width, photograph.height, row * TILE);
        let mask = rows.mask() & ((1 << TILE.min(height - top)) - 1);
        canvas.batches.resize_with(list.len().div_ceil(BATCH), Batch::default);
        for (batch, list) in canvas.batches.iter_mut().zip(list.chunks(BATCH)) {
            batch.fill(records, list, width.div_ceil(TILE));
        }
        for (index, left) in (0..width).step_by(TILE).enumerate() {
            // If the image shows an object against an empty background, most tiles are empty.
            if canvas.batches.iter().all(|batch| batch.by_tile.get(index).is_empty()) {
                continue;
            }
            let WalkCanvas { sums, batches, target, drawn, walk, .. } = &mut *canvas;
            target.fill(photograph, [left, top], mask, rule.depth > 0.0);
            drawn.reset([left, top], width - left, mask);
            for (batch, first) in batches.iter().zip((0..).step_by(BATCH)) {
                drawn.draw::<V>(batch.by_tile.get(index), &batch.records, first, target);
            }
            walk.start_tile::<V>(drawn, target, rule, mask);
            let (error, pixels) = walk.error();
            walk.walk::<V>(drawn, batches, target, sums);
            canvas.squared_error += error;
            canvas.pixels += pixels;
        }
    }
}

impl WalkCanvas {
    /// Resets the results.
    fn reset(&mut self, n_records: usize) {
        self.sums.clear();
        self.sums.resize(n_records, [0.0; N_IMAGE_SUMS]);
        (self.squared_error, self.pixels) = (0.0, 0.0);
    }
}
