//! Memory layouts shared with `photometric/*.wgsl`.

use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::TILE;
use crate::render::cpu::photometric::{
    ImageSums, PackedSplat, PackedSumLocation, PackedView, PixelRule, RowSubset,
};
use crate::render::gpu::constants::N_QUARTERS;
use crate::render::gpu::error::GpuError;
use crate::render::gpu::growing::{
    BufferPart, GrowthError, IN, OUT, PartBuffers, READBACK_STAGING, UPLOAD_STAGING, copy_all,
};
use bytemuck::{Pod, Zeroable, cast_slice};
use wgpu::{BufferUsages as Usage, WriteOnly};

/// Bytes per splat.
pub(super) const SPLAT_BYTES: usize = size_of::<PackedSplat>();
/// Bytes per location of sums.
pub(super) const PLACE_BYTES: usize = size_of::<PackedSumLocation>();
/// Bytes per splat's sums.
pub(super) const SUM_BYTES: usize = size_of::<ImageSums>();
/// Bytes per pixel of the photograph.
pub(super) const MEASURED_BYTES: usize = size_of::<MeasuredPixel>();
/// Bytes per pixel between the walks.
pub(super) const PIXEL_BYTES: usize = 64;

/// `Frame` of `pixel.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Frame {
    size: [u32; 2],
    columns: u32,
    n_splats: u32,
    every: u32,
    first: u32,
    full_coverage: f32,
    per_tau: f32,
    coverage: f32,
    depth: f32,
}

impl Frame {
    pub(super) fn new(
        photograph: &Image<MeasuredPixel>,
        n_splats: usize,
        rule: PixelRule,
        rows: RowSubset,
    ) -> Self {
        Self {
            size: [photograph.width as u32, photograph.height as u32],
            columns: photograph.width.div_ceil(TILE) as u32,
            n_splats: n_splats as u32,
            every: rows.stride(),
            first: rows.first(),
            full_coverage: rule.full_coverage,
            per_tau: 1.0 / (rule.tau * rule.tau),
            coverage: rule.coverage,
            depth: rule.depth,
        }
    }
}

/// `photometric/draw.wgsl`: draws the splats and compares the pixels with the photograph.
pub const DRAW: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/draw.wgsl")
);
/// `photometric/walk.wgsl`: sums of every splat in every tile.
pub const WALK: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/place.wgsl"),
    include_str!("../../../../shaders/photometric/walk.wgsl")
);
/// `photometric/add.wgsl`: sums of every splat over its tiles.
pub const ADD: &str = concat!(
    include_str!("../../../../shaders/photometric/pixel.wgsl"),
    include_str!("../../../../shaders/photometric/place.wgsl"),
    include_str!("../../../../shaders/photometric/add.wgsl")
);

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

const WORD: u64 = size_of::<u32>() as u64;

/// Contents of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Splats,
    Places,
    Starts,
    Entries,
    Photograph,
    /// Per chosen pixel, between the walks.
    Pixels,
    /// Per tile: squared error and number of pixels.
    Errors,
    /// Per splat-tile pair: whether a pixel shows the splat.
    Shown,
    /// Per splat-tile pair.
    PartialSums,
    /// Per splat.
    Totals,
    /// Staging buffer for uploads.
    Upload,
    /// Staging buffer for results.
    Readback,
}

/// All parts in order, with label and usage.
const PARTS: [(Part, &str, Usage); 13] = [
    (Part::Frame, "comparison", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Splats, "compared splats", IN),
    (Part::Places, "locations of sums", IN),
    (Part::Starts, "first splats of tiles", IN),
    (Part::Entries, "splats of tiles", IN),
    (Part::Photograph, "photograph", IN),
    (Part::Pixels, "compared pixels", Usage::STORAGE),
    (Part::Errors, "errors of tiles", OUT),
    (Part::Shown, "visible splats of tiles", IN),
    (Part::PartialSums, "sums by tile", Usage::STORAGE),
    (Part::Totals, "sums by splat", OUT),
    (Part::Upload, "upload of comparison", UPLOAD_STAGING),
    (Part::Readback, "readback of sums", READBACK_STAGING),
];

/// Sizes of a comparison.
#[derive(Clone, Copy, Debug)]
pub(super) struct ComparisonSizes {
    pub(super) splats: u64,
    pub(super) tiles: u64,
    /// Number of splat-tile pairs.
    pub(super) entries: u64,
    /// Number of pixels in the chosen rows of the photograph.
    pub(super) pixels: u64,
    /// Number of chosen pixels per tile.
    pub(super) lanes: u64,
}

impl ComparisonSizes {
    pub(super) fn bytes(&self, part: Part) -> u64 {
        let Self { splats, tiles, entries, pixels, lanes } = *self;
        match part {
            Part::Frame => size_of::<Frame>() as u64,
            Part::Splats => splats * SPLAT_BYTES as u64,
            Part::Places => splats * PLACE_BYTES as u64,
            Part::Starts => (tiles + 1) * WORD,
            Part::Entries | Part::Shown => entries * WORD,
            Part::Photograph => pixels * MEASURED_BYTES as u64,
            Part::Pixels => tiles * lanes * PIXEL_BYTES as u64,
            Part::Errors => tiles * 8,
            Part::PartialSums => entries * u64::from(N_QUARTERS) * 16,
            Part::Totals => splats * SUM_BYTES as u64,
            Part::Upload => UPLOADED.iter().map(|&part| self.bytes(part)).sum(),
            Part::Readback => self.bytes(Part::Errors) + self.bytes(Part::Totals),
        }
    }
}

/// Parts to upload, in the order of [`Part::Upload`].
pub(super) const UPLOADED: [Part; 6] =
    [Part::Frame, Part::Splats, Part::Places, Part::Starts, Part::Entries, Part::Photograph];

/// All buffers, each as large as the largest size requested so far.
pub(super) type Memory = PartBuffers<Part>;

impl BufferPart for Part {
    type Sizes = ComparisonSizes;
    const ALL: &'static [(Self, &'static str, Usage)] = &PARTS;

    fn index(self) -> usize {
        self as usize
    }

    fn bytes(self, sizes: &ComparisonSizes) -> u64 {
        sizes.bytes(self)
    }
}

/// Ensures the sizes of all buffers.
///
/// # Errors
/// [`GpuError::ComparisonTooLarge`], [`GpuError::NoMemoryToCompare`].
pub(super) fn ensure_capacity(
    memory: &mut Memory,
    device: &wgpu::Device,
    sizes: &ComparisonSizes,
) -> Result<(), GpuError> {
    for (part, ..) in PARTS {
        memory.ensure_part(device, sizes, part).map_err(|error| match error {
            GrowthError::TooLarge { needed_mib, limit_mib } => {
                GpuError::ComparisonTooLarge { needed_mib, limit_mib }
            }
            GrowthError::Refused { mib } => GpuError::NoMemoryToCompare { mib },
        })?;
    }
    Ok(())
}

#[cfg(test)]
mod memory_tests {
    use super::*;

    #[test]
    fn parts_lie_at_their_places() {
        for (at, (part, ..)) in PARTS.into_iter().enumerate() {
            assert_eq!(part as usize, at);
        }
    }
}
