//! Writes the inputs of a comparison directly to mapped memory.

use super::layout::{Frame, MEASURED_BYTES};
use super::memory::{ComparisonSizes, Part, UPLOADED};
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::TILE;
use crate::render::cpu::photometric::{PackedView, PixelRule, RowSubset};
use crate::render::gpu::parallel_copy::copy_all;
use bytemuck::cast_slice;
use wgpu::WriteOnly;

/// View and photograph to compare.
#[derive(Clone, Copy)]
pub(super) struct Comparison<'a> {
    pub(super) packed: &'a PackedView,
    pub(super) photograph: &'a Image<MeasuredPixel>,
    pub(super) rule: PixelRule,
    pub(super) rows: RowSubset,
}

/// Number of tile columns and rows of a photograph.
pub(super) fn tile_grid(photograph: &Image<MeasuredPixel>) -> (usize, usize) {
    (photograph.width.div_ceil(TILE), photograph.height.div_ceil(TILE))
}

impl Comparison<'_> {
    pub(super) fn sizes(&self) -> ComparisonSizes {
        let Self { packed, photograph, rows, .. } = *self;
        let (columns, tile_rows) = tile_grid(photograph);
        ComparisonSizes {
            splats: packed.splats.len() as u64,
            tiles: (columns * tile_rows) as u64,
            entries: packed.entries.len() as u64,
            pixels: (self.chosen_rows().count() * photograph.width) as u64,
            lanes: (TILE * TILE / rows.stride() as usize) as u64,
        }
    }

    fn chosen_rows(&self) -> impl Iterator<Item = usize> {
        let rows = self.rows;
        (rows.first() as usize..self.photograph.height).step_by(rows.stride() as usize)
    }

    /// Fills the memory of [`Part::Upload`].
    pub(super) fn write(&self, memory: WriteOnly<'_, [u8]>, load: &ComparisonSizes) {
        let Self { packed, photograph, rule, rows } = *self;
        let frame = Frame::new(photograph, packed.splats.len(), rule, rows);
        let (mut rest, mut copies) = (memory, Vec::new());
        for part in UPLOADED {
            // The buffer has exactly the sizes of its parts.
            let to = rest.split_off(..load.bytes(part) as usize).unwrap_or_default();
            match part {
                Part::Frame => copies.push((to, bytemuck::bytes_of(&frame))),
                Part::Splats => copies.push((to, cast_slice(&packed.splats))),
                Part::Places => copies.push((to, cast_slice(&packed.places))),
                Part::Starts => copies.push((to, cast_slice(&packed.starts))),
                Part::Entries => copies.push((to, cast_slice(&packed.entries))),
                _ => copies.extend(self.photograph_lines(to)),
            }
        }
        copy_all(copies.into_iter());
    }

    /// Chosen pixel rows with their destinations; a single piece if all rows are chosen.
    fn photograph_lines<'m>(
        &self,
        to: WriteOnly<'m, [u8]>,
    ) -> impl Iterator<Item = (WriteOnly<'m, [u8]>, &[u8])> {
        let Self { photograph, rows, .. } = *self;
        let is_whole = rows == RowSubset::ALL;
        let n_pixels = if is_whole { photograph.data.len() } else { photograph.width };
        let firsts = self.chosen_rows().map(|row| row * photograph.width);
        let mut rest = to;
        firsts.take(if is_whole { 1 } else { usize::MAX }).map(move |first| {
            let pixels = &photograph.data[first..][..n_pixels];
            let line = rest.split_off(..n_pixels * MEASURED_BYTES).unwrap_or_default();
            (line, cast_slice(pixels))
        })
    }
}

/// Byte offset of a part in [`Part::Upload`].
pub(super) fn offset(part: Part, load: &ComparisonSizes) -> u64 {
    UPLOADED.iter().take_while(|&&before| before != part).map(|&part| load.bytes(part)).sum()
}
