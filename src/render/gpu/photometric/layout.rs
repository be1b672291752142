//! Memory layouts shared with `photometric/*.wgsl`.

use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::TILE;
use crate::render::cpu::photometric::{
    ImageSums, PackedSplat, PackedSumLocation, PackedView, PixelRule, RowSubset,
};
use crate::render::gpu::constants::{N_QUARTERS, wgsl};
use crate::render::gpu::task::{Bindings, IN, OUT, PartRow, SETTINGS, TaskPart, WORD, bytes_of};
use bytemuck::{Pod, Zeroable, cast_slice};
use wgpu::BufferUsages as Usage;

/// Bytes per pixel of the state stored between the two walks.
const PIXEL_BYTES: u64 = 64;
/// Bytes per splat-tile pair: its sums, padded to `vec4` values.
const QUARTERS_BYTES: u64 = N_QUARTERS as u64 * 16;

/// Settings of a comparison: `Frame` of `pixel.wgsl`.
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

/// `photometric/draw.wgsl`: draws the splats and compares the pixels with the photograph.
pub const DRAW: &str = wgsl!("photometric/pixel", "photometric/draw");
/// `photometric/walk.wgsl`: computes the sums of every splat in every tile.
pub const WALK: &str = wgsl!("photometric/pixel", "photometric/place", "photometric/walk");
/// `photometric/add.wgsl`: adds the sums of every splat over its tiles.
pub const ADD: &str = wgsl!("photometric/pixel", "photometric/place", "photometric/add");

#[derive(Clone, Copy)]
pub(super) struct Comparison<'a> {
    pub(super) packed: &'a PackedView,
    pub(super) photograph: &'a Image<MeasuredPixel>,
    pub(super) rule: PixelRule,
    pub(super) rows: RowSubset,
}

/// Returns the number of tile columns and rows of a photograph.
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
        let Self { packed, photograph, rule, rows } = *self;
        Frame {
            size: [photograph.width as u32, photograph.height as u32],
            columns: photograph.width.div_ceil(TILE) as u32,
            n_splats: packed.splats.len() as u32,
            every: rows.stride(),
            first: rows.first(),
            full_coverage: rule.full_coverage,
            per_tau: 1.0 / (rule.tau * rule.tau),
            coverage: rule.coverage,
            depth: rule.depth,
        }
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

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Splats,
    Places,
    Starts,
    Entries,
    Photograph,
    /// State of each compared pixel between the two walks.
    Pixels,
    /// Squared error and number of covered pixels of each tile.
    Errors,
    /// Flag of each splat-tile pair, set if a pixel of the tile shows the splat.
    Shown,
    /// Sums of each splat-tile pair.
    PartialSums,
    /// Sums of each splat over its tiles.
    Totals,
}

/// Buffers bound by the kernel that draws. `WALKED` and `ADDED` list the buffers of the kernels that
/// walk and add.
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
    /// Number of pixels in the compared rows of the photograph.
    pub(super) pixels: u64,
    /// Number of compared pixels per tile.
    pub(super) lanes: u64,
}

impl TaskPart for Part {
    type Sizes = ComparisonSizes;
    const LABEL: &'static str = "comparison with a photograph";
    const ALL: &'static [PartRow<Self>] = &[
        (Part::Frame, "settings of a comparison", SETTINGS, |_| bytes_of::<Frame>()),
        (Part::Splats, "compared splats", IN, |n| n.splats * bytes_of::<PackedSplat>()),
        (Part::Places, "locations of sums", IN, |n| n.splats * bytes_of::<PackedSumLocation>()),
        // One more than tiles, for the end of the last list.
        (Part::Starts, "first splats of tiles", IN, |n| (n.tiles + 1) * WORD),
        (Part::Entries, "splats of tiles", IN, |n| n.entries * WORD),
        (Part::Photograph, "a photograph", IN, |n| n.pixels * bytes_of::<MeasuredPixel>()),
        (Part::Pixels, "compared pixels", Usage::STORAGE, |n| n.tiles * n.lanes * PIXEL_BYTES),
        (Part::Errors, "errors of tiles", OUT, |n| n.tiles * 2 * WORD),
        // `IN`, because it is cleared before the walk.
        (Part::Shown, "visible splats of tiles", IN, |n| n.entries * WORD),
        (Part::PartialSums, "sums by tile", Usage::STORAGE, |n| n.entries * QUARTERS_BYTES),
        (Part::Totals, "sums by splat", OUT, |n| n.splats * bytes_of::<ImageSums>()),
    ];
    const UPLOADS: &'static [&'static str] = &["upload of a comparison"];

    fn index(self) -> usize {
        self as usize
    }
}
