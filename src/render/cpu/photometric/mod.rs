//! What a photograph says of the splats that a view shows: gradient and Gauss-Newton blocks per splat
//! (`photometric.md`, Image plane).
//!
//! Two walks over every tile, both from front to back: the first draws, the second compares and adds.
//! Sums are formed tile by tile and row by row, and rows are added in their order, so they have the
//! same bits for any number of threads and any instruction set. Only the projected renderer is
//! differentiated: it is what evaluation and other programs draw with.

mod blocks;
mod compared;
mod lift;
mod row;
mod sums;
mod walk;

pub use blocks::ParameterSums;
pub use compared::{Compared, SeenSplat};
pub use row::RowChoice;
pub use walk::PixelRule;

use super::lists::ViewLists;
use super::view::CpuView;
use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::simd::Isa;
use crate::model::splat::appearance::SplatView;
use crate::render::constants::TILE;
use crate::render::options::{RenderMethod, RenderOptions};
use rayon::prelude::*;
use row::{WalkCanvas, WalkRow};
use sums::{ImageSums, N_IMAGE_SUMS};

/// Least records per parallel task of adding rows up.
const MIN_TASK: usize = 2048;

/// Compares photographs with splats; keeps its buffers between views.
#[derive(Default)]
pub struct PhotometricWalk {
    lists: ViewLists,
    canvases: Vec<WalkCanvas>,
    totals: Vec<ImageSums>,
}

impl PhotometricWalk {
    /// Compares the chosen rows of a photograph with the picture of `splats` from where it was taken.
    /// Its pixels are sRGB-encoded red, green and blue over black, and how much of them surfaces
    /// cover: NaN where that is not known and what is mostly covered counts as covered.
    pub fn compare(
        &mut self,
        splats: SplatView<'_>,
        camera: &Camera,
        photograph: &Image<[f32; 4]>,
        rule: PixelRule,
        rows: RowChoice,
    ) -> Compared<'_> {
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let view = CpuView::new(camera, &options);
        self.lists.prepare(splats, &view);
        self.lists.sort();
        self.lists.bin(photograph.height);
        self.walk(photograph, rule, rows);
        self.add_rows();
        let (squared_error, pixels) = self
            .canvases
            .iter()
            .fold((0.0, 0.0), |(error, n), row| (error + row.squared_error, n + row.pixels));
        Compared { view, lists: &self.lists, totals: &self.totals, squared_error, pixels }
    }

    fn walk(&mut self, photograph: &Image<[f32; 4]>, rule: PixelRule, rows: RowChoice) {
        let (isa, ViewLists { records, rows: lists, .. }) = (Isa::best(), &self.lists);
        let n_rows = if photograph.width > 0 { photograph.height.div_ceil(TILE) } else { 0 };
        self.canvases.resize_with(n_rows, WalkCanvas::default);
        // One row a task: rows differ much in how many splats they hold.
        let canvases = self.canvases.par_iter_mut().enumerate().with_max_len(1);
        canvases.for_each(|(row, canvas)| {
            let list = lists.get(row);
            isa.run(WalkRow { records, list, row, photograph, rule, rows, canvas });
        });
    }

    /// Row after row: the order of additions is part of the result. Every task goes through all rows
    /// and keeps its own records, as listing by row does, so there are no more tasks than threads.
    fn add_rows(&mut self) {
        let (canvases, lists) = (&self.canvases, &self.lists.rows);
        let n_records = self.lists.records.records.len();
        let of_task = n_records.div_ceil(rayon::current_num_threads()).max(MIN_TASK);
        self.totals.resize(n_records, [0.0; N_IMAGE_SUMS]);
        self.totals.par_chunks_mut(of_task).enumerate().for_each(|(task, totals)| {
            totals.fill([0.0; N_IMAGE_SUMS]);
            let first = (task * of_task) as u32;
            let rows = canvases.iter().enumerate();
            for (&record, sums) in rows.flat_map(|(i, row)| lists.get(i).iter().zip(&row.sums)) {
                // Records before the first wrap around and lie behind the last.
                if let Some(total) = totals.get_mut(record.wrapping_sub(first) as usize) {
                    total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
                }
            }
        });
    }
}
