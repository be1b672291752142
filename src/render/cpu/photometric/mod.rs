//! What a photograph says of the splats that a view shows: gradient and Gauss-Newton blocks per splat
//! (`photometric.md`, Image plane).
//!
//! Two walks over every tile, both from front to back: the first draws, the second compares and adds.
//! Sums are formed tile by tile and row by row, and rows are added in their order, so they have the
//! same bits for any number of threads and any instruction set. Only the projected renderer is
//! differentiated: it is what evaluation and other programs draw with.

mod lift;
mod sums;
mod walk;

pub use lift::ParameterSums;
pub use walk::PixelRule;

use super::projected;
use super::raster::{BATCH, Batch};
use super::record::{ConicRecord, DepthEntry, Gradient, Records};
use super::rows::RowLists;
use super::shade::{self, ColorGradient};
use super::sort::{DepthSorter, Keyed};
use super::tile::{Form, Tile};
use super::view::CpuView;
use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::simd::{Isa, Kernel, Vector};
use crate::model::splat::appearance::SplatView;
use crate::render::constants::TILE;
use crate::render::options::{RenderMethod, RenderOptions, Support};
use lift::lift;
use rayon::prelude::*;
use sums::{ImageSums, N_IMAGE_SUMS};
use walk::SecondWalk;

/// Splats per parallel task.
const MIN_TASK: usize = 512;

/// What a photograph says of the splats of a view.
#[derive(Debug, Default)]
pub struct PhotometricSums {
    /// Splats that pixels show, ascending, each with its sums.
    pub splats: Vec<(u32, ParameterSums)>,
    /// Sum of squared differences between photograph and picture, over the channels of covered pixels.
    pub squared_error: f64,
    /// Covered pixels that count.
    pub pixels: f64,
}

/// Compares photographs with splats; keeps its buffers between views.
#[derive(Default)]
pub struct PhotometricWalk {
    records: Records,
    listings: Vec<DepthEntry>,
    visible: Vec<Keyed>,
    sorter: DepthSorter,
    rows: RowLists,
    /// Splat of every record.
    ids: Vec<u32>,
    totals: Vec<ImageSums>,
}

/// A splat that the view may show.
struct Drawn {
    id: u32,
    record: ConicRecord,
    listing: DepthEntry,
    gradient: Gradient,
}

impl PhotometricWalk {
    /// Compares a photograph with the picture of `splats` from where it was taken. Its pixels are
    /// sRGB-encoded red, green and blue over black, and how much of them surfaces cover: NaN where that
    /// is not known.
    pub fn compare(
        &mut self,
        splats: SplatView<'_>,
        camera: &Camera,
        photograph: &Image<[f32; 4]>,
        rule: PixelRule,
    ) -> PhotometricSums {
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let view = CpuView::new(camera, &options);
        if photograph.data.is_empty() {
            return PhotometricSums::default();
        }
        self.prepare(splats, &view);
        self.sorter.sort(&mut self.visible);
        self.rows.fill(photograph.height.div_ceil(TILE), &self.visible, &self.listings);
        let (squared_error, pixels) = self.walk(photograph, rule);
        let found = self.ids.par_iter().zip(&self.totals).with_min_len(MIN_TASK);
        let lifted = found.filter_map(|(&id, sums)| {
            let is_seen = sums[sums::WEIGHT] > 0.0;
            let slot = id as usize;
            let appearance = splats.appearance().get(slot).copied().unwrap_or_default();
            let lifted = || lift(&view, &splats.splats()[slot], &appearance, sums);
            Some((id, is_seen.then(lifted)??))
        });
        PhotometricSums { splats: lifted.collect(), squared_error, pixels }
    }

    fn prepare(&mut self, splats: SplatView<'_>, view: &CpuView) {
        let drawn: Vec<Drawn> = (0..splats.splats().len())
            .into_par_iter()
            .with_min_len(MIN_TASK)
            .filter_map(|i| drawn(splats, view, i))
            .collect();
        self.ids.clear();
        self.listings.clear();
        self.records.records.clear();
        self.records.gradients.clear();
        for splat in drawn {
            self.ids.push(splat.id);
            self.listings.push(splat.listing);
            self.records.records.push(splat.record);
            self.records.gradients.push(splat.gradient);
        }
        self.visible.clear();
        self.visible.extend(self.listings.iter().zip(0..).map(|(entry, i)| entry.keyed(i)));
    }

    /// Fills the totals; squared error and number of the pixels.
    fn walk(&mut self, photograph: &Image<[f32; 4]>, rule: PixelRule) -> (f64, f64) {
        let (isa, records, lists) = (Isa::best(), &self.records, &self.rows);
        let rows: Vec<RowSums> = (0..photograph.height.div_ceil(TILE))
            .into_par_iter()
            .with_max_len(1)
            .map(|row| isa.run(WalkRow { records, list: lists.get(row), row, photograph, rule }))
            .collect();
        self.totals.clear();
        self.totals.resize(self.ids.len(), [0.0; N_IMAGE_SUMS]);
        let (mut error, mut pixels) = (0.0, 0.0);
        // Row after row: the order of additions is part of the result.
        for (row, of_row) in rows.iter().enumerate() {
            error += of_row.squared_error;
            pixels += of_row.pixels;
            for (&record, sums) in lists.get(row).iter().zip(&of_row.sums) {
                let total = &mut self.totals[record as usize];
                total.iter_mut().zip(sums).for_each(|(total, sum)| *total += sum);
            }
        }
        (error, pixels)
    }
}

fn drawn(splats: SplatView<'_>, view: &CpuView, i: usize) -> Option<Drawn> {
    let splat = &splats.splats()[i];
    let appearance = splats.appearance().get(i);
    let is_valid = splat.is_drawable() && appearance.is_none_or(|a| a.is_valid());
    let placed = is_valid.then(|| view.place(splat))??;
    let color = shade::color(view, splat, &placed, appearance);
    let gradient = appearance.map_or_else(Gradient::default, |appearance| {
        projected::gradient(&ColorGradient::new(appearance, view), &placed, view)
    });
    let (record, key) = projected::draw(view, &placed, Support::Alpha)?.record(color)?;
    Some(Drawn { id: i as u32, record, listing: DepthEntry::new(key, &record.rect), gradient })
}

/// Sums of one row of tiles, in the order of its list.
struct RowSums {
    sums: Vec<ImageSums>,
    squared_error: f64,
    pixels: f64,
}

struct WalkRow<'a> {
    records: &'a Records,
    list: &'a [u32],
    row: usize,
    photograph: &'a Image<[f32; 4]>,
    rule: PixelRule,
}

impl Kernel for WalkRow<'_> {
    type Output = RowSums;

    #[inline(always)]
    fn run<V: Vector>(self) -> RowSums {
        let Self { records, list, row, photograph, rule } = self;
        let (width, height, top) = (photograph.width, photograph.height, row * TILE);
        let mut tiles: Vec<Tile> = (0..width)
            .step_by(TILE)
            .map(|left| Tile::new(left, top, width - left, height - top))
            .collect();
        let mut batches = Vec::new();
        for list in list.chunks(BATCH) {
            let mut batch = Batch::default();
            batch.fill(records, list, tiles.len());
            for (index, tile) in tiles.iter_mut().enumerate() {
                let (list, records) = (batch.by_tile.get(index), &batch.records);
                tile.blend_all::<V, { Form::PROJECTED }, true>(list, records, 1.0);
            }
            batches.push(batch);
        }
        let mut out = RowSums {
            sums: vec![[0.0; N_IMAGE_SUMS]; list.len()],
            squared_error: 0.0,
            pixels: 0.0,
        };
        for (index, tile) in tiles.iter().enumerate() {
            let mut walk = SecondWalk::new(tile, photograph, rule);
            let (error, pixels) = walk.error();
            out.squared_error += error;
            out.pixels += pixels;
            for (batch, sums) in batches.iter().zip(out.sums.chunks_mut(BATCH)) {
                walk.walk::<V>(batch.by_tile.get(index), &batch.records, sums);
            }
        }
        out
    }
}
