//! Memory layouts shared with `photometric/*.wgsl`.

use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::TILE;
use crate::render::cpu::photometric::{
    ImageSums, PackedSplat, PackedSumLocation, PackedView, PixelRule, RowSubset,
};
use crate::render::gpu::constants::N_QUARTERS;
use crate::render::gpu::task::{Bindings, IN, OUT, SETTINGS, TaskPart};
use bytemuck::{Pod, Zeroable, cast_slice};
use wgpu::BufferUsages as Usage;

pub(super) const SPLAT_BYTES: usize = size_of::<PackedSplat>();
pub(super) const PLACE_BYTES: usize = size_of::<PackedSumLocation>();
pub(super) const SUM_BYTES: usize = size_of::<ImageSums>();
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

    pub(super) fn frame(&self) -> Frame {
        Frame::new(self.photograph, self.packed.splats.len(), self.rule, self.rows)
    }

    pub(super) fn pieces(&self) -> impl Iterator<Item = (Part, &[u8])> {
        let Self { packed, photograph, rows, .. } = *self;
        let lists = [
            (Part::Splats, cast_slice(&packed.splats)),
            (Part::Places, cast_slice(&packed.places)),
            (Part::Starts, cast_slice(&packed.starts)),
            (Part::Entries, cast_slice(&packed.entries)),
        ];
        // A single piece if all rows are chosen.
        let is_whole = rows == RowSubset::ALL;
        let n_pixels = if is_whole { photograph.data.len() } else { photograph.width };
        let firsts = self.chosen_rows().map(|row| row * photograph.width);
        let lines = firsts.take(if is_whole { 1 } else { usize::MAX });
        let line =
            move |first| (Part::Photograph, cast_slice(&photograph.data[first..][..n_pixels]));
        lists.into_iter().chain(lines.map(line))
    }
}

const WORD: u64 = size_of::<u32>() as u64;

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
}

/// Parts bound by the kernels.
pub(super) const DRAWN: Bindings<Part> = &[
    (0, Part::Frame),
    (1, Part::Splats),
    (2, Part::Entries),
    (3, Part::Starts),
    (4, Part::Photograph),
    (5, Part::Pixels),
    (6, Part::Errors),
];
pub(super) const WALKED: Bindings<Part> = &[
    (0, Part::Frame),
    (1, Part::Splats),
    (2, Part::Entries),
    (3, Part::Starts),
    (4, Part::Places),
    (5, Part::Pixels),
    (6, Part::Shown),
    (7, Part::PartialSums),
];
pub(super) const ADDED: Bindings<Part> = &[
    (0, Part::Frame),
    (4, Part::Places),
    (5, Part::Shown),
    (6, Part::PartialSums),
    (7, Part::Totals),
];

#[derive(Clone, Copy, Debug, Default)]
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

impl TaskPart for Part {
    type Sizes = ComparisonSizes;
    const LABEL: &'static str = "comparison with a photograph";
    const ALL: &'static [(Self, &'static str, Usage)] = &[
        (Part::Frame, "settings of a comparison", SETTINGS),
        (Part::Splats, "compared splats", IN),
        (Part::Places, "locations of sums", IN),
        (Part::Starts, "first splats of tiles", IN),
        (Part::Entries, "splats of tiles", IN),
        (Part::Photograph, "a photograph", IN),
        (Part::Pixels, "compared pixels", Usage::STORAGE),
        (Part::Errors, "errors of tiles", OUT),
        (Part::Shown, "visible splats of tiles", IN),
        (Part::PartialSums, "sums by tile", Usage::STORAGE),
        (Part::Totals, "sums by splat", OUT),
    ];
    const UPLOADS: &'static [&'static str] = &["upload of a comparison"];

    fn index(self) -> usize {
        self as usize
    }

    fn bytes(self, sizes: &ComparisonSizes) -> u64 {
        let ComparisonSizes { splats, tiles, entries, pixels, lanes } = *sizes;
        match self {
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
        }
    }
}
