//! Gradients and Gauss-Newton blocks of the visible splats from one photograph (`photographs.md`, Image
//! plane).
//!
//! Each tile is walked twice from front to back: the first walk draws, the second compares and sums.
//! Sums are formed per tile and row, and rows are added in order. So results are bit-identical for any
//! number of threads and any instruction set. Only the projected renderer is differentiated, because
//! evaluation and other programs use it.

mod blocks;
mod drawn;
mod lift;
mod moments;
#[cfg(feature = "gui")]
mod packed;
mod target;
mod walk;

use super::raster::{BATCH, Batch};
use super::record::Records;
use super::rows::{ViewLists, longest_first};
use crate::math::image::{Image, split_by_sizes};
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::model::inspection::DeviceError;
use crate::render::options::TILE;
use blocks::SumOrder;
use drawn::DrawnTile;
#[cfg(feature = "gui")]
pub(in crate::render) use packed::{PackedSplat, PackedSumLocation, PackedView};
use rayon::prelude::*;
use std::ops::Range;
use target::TargetTile;
use walk::SecondWalk;
#[cfg(feature = "gui")]
pub(in crate::render) use walk::{MIN_COUNTED_COVERAGE, MIN_WEIGHT};

pub use blocks::{ParameterSums, PhotometricSums, VisibleSplat};
pub use moments::{ImageSums, N_IMAGE_SUMS};
pub use target::{PreparedView, ViewBuffers};
pub use walk::PixelRule;

// Visible records per parallel task of `add_rows`, at least.
const MIN_TASK: usize = 512;

/// Compares photographs with rendered splats on the CPU. Buffers are reused between views.
#[derive(Default)]
pub struct PhotometricWalk {
    canvases: Vec<WalkCanvas>,
    totals: Vec<ImageSums>,
}

impl PhotometricWalk {
    /// Compares a photograph with its rendering as [`PhotometricComparer::compare`] does, but on the
    /// CPU, where no error can occur.
    pub fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> PhotometricSums<'a> {
        let ViewLists { records, rows: lists, .. } = view.lists;
        let n_rows = if photograph.width > 0 { photograph.height.div_ceil(TILE) } else { 0 };
        self.canvases.resize_with(n_rows, WalkCanvas::default);
        // Rows differ widely in their number of splats.
        let tasks = self.canvases.iter_mut().enumerate().map(|(row, canvas)| {
            let list = lists.get(row);
            (list.len(), WalkRow { records, list, row, photograph, rule, rows, canvas })
        });
        longest_first(tasks, &mut Vec::new(), |task, ()| Isa::best().run(task));
        self.add_rows(view.lists);
        let (squared_error, pixels) = self
            .canvases
            .iter()
            .fold((0.0, 0.0), |(error, n), row| (error + row.squared_error, n + row.pixels));
        let (view, sums, order) = (view.clone(), &self.totals[..], SumOrder::ByRecord);
        PhotometricSums { view, sums, order, squared_error, pixels }
    }

    /// Adds the sums of all rows of tiles in row order, because the order of additions affects rounding.
    /// Every task scans all rows for its own records, so there are about as many tasks as threads.
    fn add_rows(&mut self, lists: &ViewLists) {
        let (canvases, rows_of) = (&self.canvases, &lists.rows);
        let runs: Vec<Range<u32>> = lists.visible_runs().collect();
        // Visible records are clustered. Tasks with equal numbers of records, visible or not, would leave
        // most threads idle.
        let share = (lists.n_visible() / rayon::current_num_threads()).max(MIN_TASK);
        let mut n = 0;
        let tasks = runs.chunk_by(|run, _| {
            n = if n >= share { run.len() } else { n + run.len() };
            n < share
        });
        let tasks: Vec<&[Range<u32>]> = tasks.collect();
        let n_records = lists.records.records.len();
        self.totals.resize(n_records, [0.0; N_IMAGE_SUMS]);
        let firsts = || tasks.iter().map(|runs| runs[0].start as usize);
        let ends = firsts().skip(1).chain([n_records]);
        let sizes = firsts().zip(ends).map(|(first, end)| end - first);
        let totals =
            split_by_sizes(&mut self.totals, sizes).into_par_iter().zip(&tasks).with_max_len(1);
        totals.for_each(|(totals, runs)| {
            let first = runs[0].start;
            for Range { start, end } in runs.iter() {
                totals[(start - first) as usize..(end - first) as usize].fill([0.0; N_IMAGE_SUMS]);
            }
            let rows = canvases.iter().enumerate();
            for (&record, sums) in rows.flat_map(|(i, row)| rows_of.get(i).iter().zip(&row.sums)) {
                // Records before the task's first wrap around to an index past the end.
                if let Some(total) = totals.get_mut(record.wrapping_sub(first) as usize) {
                    total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
                }
            }
        });
    }
}

/// Compares photographs with rendered splats, on the CPU or another device.
pub trait PhotometricComparer: Send + Sync {
    /// Returns the device's name for reports.
    fn name(&self) -> String;

    /// Compares the chosen rows of a photograph with the rendering of the view's splats. A pixel of
    /// unknown target coverage counts as fully covered if the splats mostly cover it.
    ///
    /// # Errors
    /// [`DeviceError`] if the device is lost, runs out of memory or does not respond. No result is
    /// available in that case.
    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Result<PhotometricSums<'a>, DeviceError>;
}

/// Pixel rows to compare: row `first` and then every `every`-th row (`every` is 1, 2, 4, 8 or 16). Rows
/// are chosen rather than tiles: a splat compared in only some of its tiles would be fitted to these
/// tiles alone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RowSubset {
    every: u32,
    first: u32,
}

impl RowSubset {
    /// Largest distance between compared rows. At this distance, one row of each tile is compared.
    pub const MAX_STRIDE: u32 = TILE as u32;
    /// Compares every row.
    pub const ALL: Self = Self { every: 1, first: 0 };

    /// Chooses every `every`-th row; `every` is limited to 1 to 16 and rounded down to a power of two.
    /// Consecutive values of `turn` cycle through the possible first rows.
    pub fn new(every: u32, turn: u64) -> Self {
        // A power of two divides a tile, so every tile has equally many rows.
        let every = 1 << every.clamp(1, Self::MAX_STRIDE).ilog2();
        Self { every, first: (turn % u64::from(every)) as u32 }
    }

    /// Returns the distance between compared rows, in rows.
    pub fn stride(self) -> u32 {
        self.every
    }

    /// Index of the first compared row.
    pub fn first(self) -> u32 {
        self.first
    }

    /// Returns a mask with one bit per pixel row of a tile, set if the row is compared.
    fn mask(self) -> u32 {
        (self.first..Self::MAX_STRIDE)
            .step_by(self.every as usize)
            .fold(0, |mask, row| mask | 1 << row)
    }
}

/// Results and buffers of one row of tiles.
#[derive(Default)]
struct WalkCanvas {
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

struct WalkRow<'a> {
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
        canvas.sums.clear();
        canvas.sums.resize(list.len(), [0.0; N_IMAGE_SUMS]);
        (canvas.squared_error, canvas.pixels) = (0.0, 0.0);
        let (width, height, top) = (photograph.width, photograph.height, row * TILE);
        let mask = rows.mask() & ((1 << TILE.min(height - top)) - 1);
        canvas.batches.resize_with(list.len().div_ceil(BATCH), Batch::default);
        for (batch, list) in canvas.batches.iter_mut().zip(list.chunks(BATCH)) {
            batch.fill(records, list, &(0..width.div_ceil(TILE)));
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
            walk.walk::<V>(drawn, batches, target, sums);
            let (error, pixels) = walk.error;
            canvas.squared_error += error;
            canvas.pixels += pixels;
        }
    }
}
