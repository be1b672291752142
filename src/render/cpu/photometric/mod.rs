//! Gradients and Gauss-Newton blocks of the visible splats from one photograph (`photometric.md`, Image
//! plane).
//!
//! Each tile is walked twice from front to back: the first walk draws, the second compares and sums.
//! Sums are formed per tile and row, and rows are added in order, so results are bit-identical for any
//! number of threads and any instruction set. Only the projected renderer is differentiated, because
//! evaluation and other programs use it.

mod blocks;
mod compared;
mod comparer;
mod drawn;
mod lift;
mod moments;
#[cfg(feature = "gui")]
mod packed;
mod row;
mod sums;
mod target;
mod view;
mod walk;

pub use blocks::ParameterSums;
pub use compared::{PhotometricSums, VisibleSplat};
pub use comparer::{ComparerError, PhotometricComparer};
#[cfg(feature = "gui")]
pub(in crate::render) use packed::{PackedSplat, PackedSumLocation, PackedView};
pub use row::RowSubset;
pub use sums::{ImageSums, N_IMAGE_SUMS};
pub use view::{PreparedView, ViewBuffers};
pub use walk::PixelRule;
#[cfg(feature = "gui")]
pub(in crate::render) use walk::{MIN_COUNTED_COVERAGE, MIN_WEIGHT};

use super::lists::ViewLists;
use super::longest_first::longest_first;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pieces::split_by_sizes;
use crate::math::simd::Isa;
use crate::render::constants::TILE;
use compared::SumOrder;
use rayon::prelude::*;
use row::{WalkCanvas, WalkRow};
use std::ops::Range;

/// Minimum number of visible records per parallel task of [`PhotometricWalk::add_rows`].
const MIN_TASK: usize = 512;

/// Compares photographs with splats on the CPU. Buffers are reused between views.
#[derive(Default)]
pub struct PhotometricWalk {
    canvases: Vec<WalkCanvas>,
    totals: Vec<ImageSums>,
}

impl PhotometricComparer for PhotometricWalk {
    fn name(&self) -> String {
        "processor".to_owned()
    }

    fn compare<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Result<PhotometricSums<'a>, ComparerError> {
        Ok(self.compare_view(view, photograph, rule, rows))
    }
}

impl PhotometricWalk {
    /// Infallible form of [`PhotometricComparer::compare`].
    pub fn compare_view<'a>(
        &'a mut self,
        view: &PreparedView<'a>,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) -> PhotometricSums<'a> {
        self.walk_rows(view.lists, photograph, rule, rows);
        self.add_rows(view.lists);
        let (squared_error, pixels) = self
            .canvases
            .iter()
            .fold((0.0, 0.0), |(error, n), row| (error + row.squared_error, n + row.pixels));
        let (view, sums, order) = (view.clone(), &self.totals[..], SumOrder::ByRecord);
        PhotometricSums { view, sums, order, squared_error, pixels }
    }

    fn walk_rows(
        &mut self,
        lists: &ViewLists,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
        rows: RowSubset,
    ) {
        let (isa, ViewLists { records, rows: lists, .. }) = (Isa::best(), lists);
        let n_rows = if photograph.width > 0 { photograph.height.div_ceil(TILE) } else { 0 };
        self.canvases.resize_with(n_rows, WalkCanvas::default);
        // Rows differ widely in their number of splats.
        let tasks = self.canvases.iter_mut().enumerate().map(|(row, canvas)| {
            let list = lists.get(row);
            (list.len(), WalkRow { records, list, row, photograph, rule, rows, canvas })
        });
        longest_first(tasks, |task| isa.run(task));
    }

    /// Adds the sums of all rows in row order, because the order of additions affects rounding. Every task
    /// scans all rows for its own records, so the number of tasks is close to the number of threads.
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
