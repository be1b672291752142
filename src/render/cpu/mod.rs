//! The CPU renderer: evaluation everywhere, and the viewport where no real GPU exists.
//!
//! Four stages (`rendering.md` (e)): prepare (parallel), radix sort by depth, list splats per row of
//! tiles, rasterise (one task per row of tiles). A tile is drawn by one thread from one sorted list,
//! so an image has the same bits for any number of threads.

mod buckets;
mod lanes;
pub mod oracle;
mod prepare;
mod raster;
mod sort;

use super::{RenderOptions, TILE};
use crate::math::camera::Camera;
use crate::math::image::{Image, RgbImage};
use crate::model::appearance::SplatView;
use crate::model::splats::Splat;
use buckets::Buckets;
use prepare::{Record, View};
use raster::RowCanvas;
use rayon::prelude::*;
use sort::{DepthSorter, Keyed};

/// An image and what lies behind it; all planes have the size of the camera's image.
#[derive(Clone, Debug)]
pub struct Rendered {
    /// sRGB-encoded colour over the background, clamped to `[0, 1]`.
    pub color: RgbImage,
    /// `A = 1 − T` in `[0, 1]`.
    pub coverage: Image<f32>,
    /// View depth `z` in world units, averaged with the blending weights; 0 where `A` is 0.
    pub depth: Image<f32>,
    /// Splats dropped because a field is not finite or the quaternion is zero. Empty slots and
    /// splats out of sight do not count.
    pub n_invalid: usize,
}

/// Renders splats by their projected covariance (`rendering.md` (b)). Keeps its buffers between
/// images, so one renderer per view is cheaper than one per image.
#[derive(Default)]
pub struct CpuRenderer {
    records: Vec<Record>,
    counts: Vec<prepare::ChunkCount>,
    visible: Vec<Keyed>,
    sorter: DepthSorter,
    /// Visible records by row of tiles, nearest first. Rows rather than tiles: the lists stay short
    /// even when every splat covers the image, and each row bins its own tiles in parallel.
    rows: Buckets,
    canvases: Vec<RowCanvas>,
}

impl CpuRenderer {
    /// A renderer without buffers yet.
    pub fn new() -> Self {
        Self::default()
    }

    /// Renders one image on the current rayon pool. Never fails: splats that cannot be drawn are
    /// skipped, an image without pixels is returned as such.
    ///
    /// ```
    /// use glam::DVec3;
    /// use vbgs_studio::math::{camera::{Camera, Intrinsics}, pose::Pose};
    /// use vbgs_studio::model::splats::Splat;
    /// use vbgs_studio::render::{Method, RenderOptions, cpu::CpuRenderer};
    ///
    /// let camera = Camera {
    ///     intrinsics: Intrinsics::from_horizontal_fov(65, 65, 0.8),
    ///     pose: Pose::IDENTITY,
    /// };
    /// let red = Splat {
    ///     mean: [0.0, 0.0, 4.0],
    ///     opacity: 0.8,
    ///     color: [1.0, 0.0, 0.0],
    ///     scale: [0.1; 3],
    ///     rotation: [1.0, 0.0, 0.0, 0.0],
    /// };
    /// let options = RenderOptions::evaluation(Method::PROJECTED, [1.0; 3]);
    /// let image = CpuRenderer::new().render(&[red], &camera, &options);
    /// assert!((image.coverage.at(32, 32) - 0.8).abs() < 1e-6);
    /// assert!((image.color.at(32, 32)[1] - 0.2).abs() < 1e-6);
    /// assert!((image.depth.at(32, 32) - 4.0).abs() < 1e-5);
    /// assert_eq!(*image.color.at(0, 0), [1.0; 3]);
    /// ```
    pub fn render<'a>(
        &mut self,
        splats: impl Into<SplatView<'a>>,
        camera: &Camera,
        options: &RenderOptions,
    ) -> Rendered {
        let splats: SplatView<'a> = splats.into();
        let view = View::new(camera, options);
        let (width, height) = (view.width, view.height);
        let mut image = Rendered {
            color: Image::filled(width, height, [0.0; 3]),
            coverage: Image::filled(width, height, 0.0),
            depth: Image::filled(width, height, 0.0),
            n_invalid: 0,
        };
        if width == 0 || height == 0 {
            return image;
        }
        image.n_invalid = self.prepare(splats.splats(), &view);
        self.sorter.sort(&mut self.visible);
        let records = &self.records;
        let sorted = self.visible.iter().map(|visible| visible.record);
        self.rows.fill(height.div_ceil(TILE), sorted, |i| records[i as usize].rect.tile_rows());
        self.rasterise(options.background, &mut image);
        image
    }

    /// Fills `records` and `visible`; the number of broken splats.
    fn prepare(&mut self, splats: &[Splat], view: &View) -> usize {
        if self.records.len() < splats.len() {
            self.records.resize(splats.len(), Record::default());
        }
        splats
            .par_chunks(prepare::CHUNK)
            .zip(self.records.par_chunks_mut(prepare::CHUNK))
            .map(|(splats, records)| prepare::prepare_chunk(splats, records, view))
            .collect_into_vec(&mut self.counts);
        self.visible.clear();
        for (chunk, count) in self.counts.iter().enumerate() {
            let first = chunk * prepare::CHUNK;
            self.visible.extend(
                (first..first + count.n_visible)
                    .map(|i| Keyed { key: self.records[i].depth.to_bits(), record: i as u32 }),
            );
        }
        self.counts.iter().map(|count| count.n_invalid).sum()
    }

    fn rasterise(&mut self, background: [f32; 3], image: &mut Rendered) {
        let (width, height) = (image.color.width, image.color.height);
        let n_rows = height.div_ceil(TILE);
        self.canvases.resize_with(n_rows, RowCanvas::default);
        let (records, rows) = (&self.records, &self.rows);
        let pixels_per_row = width * TILE;
        self.canvases
            .par_iter_mut()
            .zip(image.color.data.par_chunks_mut(pixels_per_row))
            .zip(image.coverage.data.par_chunks_mut(pixels_per_row))
            .zip(image.depth.data.par_chunks_mut(pixels_per_row))
            .enumerate()
            .with_max_len(1)
            .for_each(|(row, (((canvas, color), coverage), depth))| {
                canvas.draw(row * TILE, width, height, rows.get(row), records);
                canvas.write(background, width, color, coverage, depth);
            });
    }
}
