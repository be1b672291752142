//! Rasterises one row of tiles: binning, blending, writing pixels.

use super::buckets::Buckets;
use super::record::Records;
use super::tile::{ProjectionForm, Tile};
use crate::math::camera::Intrinsics;
use crate::math::simd::{Kernel, Vector};
use crate::model::splat::texture::ShownTextures;
use crate::render::finish::Finish;
use crate::render::options::{Lens, RenderMethod, Response, TILE};
use std::ops::Range;
use wide::bytemuck::cast_slice;

// Splats binned to tiles at a time. Limits a row's lists to this many entries per tile, whatever
// the splats cover.
pub(super) const BATCH: usize = 4096;

/// Buffers for one row of tiles, reused between images.
#[derive(Default)]
pub(super) struct RowCanvas {
    pub tiles: Vec<Tile>,
    batch: Batch,
}

/// Consecutive splats of a row, nearest first, listed per tile.
#[derive(Default)]
pub(super) struct Batch {
    /// Records of the batch, copied next to each other. A row's tiles read each record several times,
    /// and the view's records are scattered in memory (`rendering.md`, CPU renderer).
    pub records: Records,
    /// Indices into `records` per tile.
    pub by_tile: Buckets,
}

impl Batch {
    /// Gathers the listed records of a view and bins them to some tiles of a row. Each record must touch one of the
    /// tiles.
    pub(super) fn fill(&mut self, all: &Records, list: &[u32], columns: &Range<usize>) {
        let Self { records, by_tile } = self;
        records.gather(all, list);
        by_tile.fill(columns.len(), 0..list.len() as u32, |i| {
            records.records[i as usize].rect.columns_within(columns)
        });
    }
}

/// Inputs shared by all rows of an image.
#[derive(Clone, Copy)]
pub(super) struct RowInputs<'a> {
    pub records: &'a Records,
    pub intrinsics: Intrinsics,
    pub method: RenderMethod,
    pub background: [f32; 3],
    pub finish: Finish,
    pub textures: Option<ShownTextures<'a>>,
    /// True if tiles without textured splats are left empty.
    pub is_for_textures: bool,
}

/// Task that draws the splats of `list` (nearest first) into one row of tiles.
pub(super) struct DrawRow<'a> {
    pub sheet: RowInputs<'a>,
    pub canvas: &'a mut RowCanvas,
    /// Index, in the image, of the topmost pixel row.
    pub top: usize,
    /// Columns of the drawn tiles.
    pub columns: Range<usize>,
    /// Records that touch the drawn tiles.
    pub list: &'a [u32],
}

impl Kernel for DrawRow<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let RenderMethod::Exact(exact) = self.sheet.method else {
            return self.draw::<V, { ProjectionForm::PROJECTED }>(1.0);
        };
        let min_front = match exact.response {
            Response::Ray => 0.0,
            Response::Line => f32::NEG_INFINITY,
        };
        match exact.lens {
            Lens::Pinhole => self.draw::<V, { ProjectionForm::PINHOLE }>(min_front),
            Lens::Fisheye => self.draw::<V, { ProjectionForm::FISHEYE }>(min_front),
        }
    }
}

impl DrawRow<'_> {
    #[inline(always)]
    fn draw<V: Vector, const FORM: u8>(self, min_front: f32) {
        let Self { sheet, canvas, top, columns, list } = self;
        canvas.clear(top, columns.clone(), &sheet);
        if sheet.is_for_textures {
            canvas.finish_plain_tiles(sheet.records, &columns, list);
        }
        for batch in list.chunks(BATCH) {
            // Batches are ordered nearest first: once every tile is full, later splats are hidden.
            if canvas.tiles.iter().all(Tile::is_finished) {
                break;
            }
            canvas.batch.fill(sheet.records, batch, &columns);
            let Batch { records, by_tile } = &canvas.batch;
            for (index, tile) in canvas.tiles.iter_mut().enumerate() {
                let list = by_tile.get(index);
                // Two loops instead of a branch per splat: scenes without gradients have no overhead.
                if sheet.records.gradients.is_empty() {
                    tile.blend_all::<V, FORM, false>(list, records, batch, min_front);
                } else {
                    tile.blend_all::<V, FORM, true>(list, records, batch, min_front);
                }
            }
        }
        if let Some(textures) = sheet.textures {
            for tile in &mut canvas.tiles {
                tile.add_textures::<V>(&sheet.intrinsics, &sheet.records.planes, textures);
            }
        }
    }
}

impl RowCanvas {
    fn clear(&mut self, top: usize, columns: Range<usize>, sheet: &RowInputs<'_>) {
        let k = &sheet.intrinsics;
        let (width, height) = (k.width as usize, k.height as usize);
        self.tiles.clear();
        self.tiles.extend(columns.map(|column| {
            let left = column * TILE;
            let mut tile = Tile::new(left, top, width - left, height - top);
            if !sheet.records.planes.is_empty() {
                tile.record_owners();
            }
            match sheet.method.lens() {
                Lens::Pinhole => tile,
                Lens::Fisheye => tile.with_fisheye_rays(k),
            }
        }));
    }

    /// Marks the tiles that none of the listed splats with a texture touches as finished.
    fn finish_plain_tiles(&mut self, records: &Records, columns: &Range<usize>, list: &[u32]) {
        let mut is_textured = vec![false; self.tiles.len()];
        for &record in list {
            if records.planes[record as usize].has_texture() {
                let touched = records.records[record as usize].rect.columns_within(columns);
                is_textured[touched].fill(true);
            }
        }
        let plain = self.tiles.iter_mut().zip(is_textured).filter(|(_, is_textured)| !is_textured);
        plain.for_each(|(tile, _)| tile.finish());
    }

    /// Applies crack filling and exposure to the pixels of all tiles and composites the pixels over the
    /// background.
    pub(super) fn finish_pixels(
        &self,
        sheet: &RowInputs<'_>,
        top: usize,
        color: &mut [[f32; 3]],
        coverage: &mut [f32],
        depth: &mut [f32],
    ) {
        let k = &sheet.intrinsics;
        let width = k.width as usize;
        let per_z =
            matches!(sheet.method, RenderMethod::Exact(exact) if exact.lens == Lens::Pinhole);
        for (index, tile) in self.tiles.iter().enumerate() {
            let left = index * TILE;
            let planes = tile.planes().map(|plane| cast_slice::<[f32; 8], f32>(plane));
            for row in 0..color.len() / width {
                for column in 0..TILE.min(width - left) {
                    let [t, r, g, b, z] = planes.map(|plane| plane[row * TILE + column]);
                    // The sign of a transmittance only marks the pixel as finished.
                    let (open, pixel) = (1.0 - t.abs(), row * width + left + column);
                    let [r, g, b, covered] = sheet.finish.apply([r, g, b, open]);
                    let t = 1.0 - covered;
                    // Stored colours may exceed 1.
                    color[pixel] = [
                        (r + t * sheet.background[0]).clamp(0.0, 1.0),
                        (g + t * sheet.background[1]).clamp(0.0, 1.0),
                        (b + t * sheet.background[2]).clamp(0.0, 1.0),
                    ];
                    coverage[pixel] = covered;
                    // Divided by the coverage before crack filling, which is the sum of the weights.
                    depth[pixel] = if open > 0.0 { z / open } else { 0.0 };
                    // The sums hold the parameter of the ray `(x, y, 1)`; the reported depth is the distance
                    // along it.
                    if per_z {
                        depth[pixel] *= k.ray(left + column, top + row).length() as f32;
                    }
                }
            }
        }
    }
}
