//! Memory layouts shared with `mixture/pass.wgsl` and `mixture/index.wgsl`.

use crate::model::conjugate::statistics::RECORD_WORDS;
use crate::model::paper::mixture_device::{GridShape, MAX_DEVICE_CANDIDATES, PassRule};
use crate::render::gpu::constants::{STRIP_CELLS, wgsl};
use crate::render::gpu::task::{Bindings, IN, OUT, PartRow, SETTINGS, TaskPart, WORD, bytes_of};
use bytemuck::{Pod, Zeroable};
use wgpu::BufferUsages as Usage;

/// Settings of the kernels that sort means into cells: `Index` of `index.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Index {
    lo: [f32; 3],
    per_unit: f32,
    dims: [i32; 3],
    n_means: u32,
    n_moved: u32,
    n_starts: u32,
    /// Padding to the size required for uniforms.
    rest: [u32; 2],
}

impl Index {
    pub(super) fn new(shape: &GridShape, [n_means, n_moved]: [u64; 2]) -> Self {
        Self {
            lo: shape.lo,
            per_unit: shape.per_unit,
            dims: shape.dims.map(|n| n as i32),
            n_means: n_means as u32,
            n_moved: n_moved as u32,
            n_starts: shape.n_cells() as u32 + 1,
            rest: [0; 2],
        }
    }
}

/// Mean of a component: `Mean` of `index.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Mean {
    pub(super) position: [f32; 3],
    pub(super) weight: f32,
    pub(super) color: [f32; 3],
    pub(super) id: u32,
}

/// Settings of a pass over a frame: `Frame` of `pass.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Frame {
    lo: [f32; 3],
    per_unit: f32,
    dims: [i32; 3],
    cell: f32,
    equal_share: [f32; MAX_DEVICE_CANDIDATES],
    equal_gain: [f32; MAX_DEVICE_CANDIDATES],
    color_ratio: f32,
    open_gap: f32,
    minus_zero: f32,
    candidates: u32,
    n_points: u32,
    n_tiles: u32,
    room: u32,
    with_sums: u32,
}

impl Frame {
    pub(super) fn new(
        means: &GridShape,
        rule: &PassRule,
        [n_points, n_tiles, room]: [usize; 3],
        with_sums: bool,
    ) -> Self {
        Self {
            lo: means.lo,
            per_unit: means.per_unit,
            dims: means.dims.map(|n| n as i32),
            cell: means.cell,
            equal_share: rule.equal_share,
            equal_gain: rule.equal_gain,
            color_ratio: rule.color_ratio,
            open_gap: rule.certain_gap,
            minus_zero: -0.0,
            candidates: rule.candidates as u32,
            n_points: n_points as u32,
            n_tiles: n_tiles as u32,
            room: room as u32,
            with_sums: u32::from(with_sums),
        }
    }
}

/// `mixture/pass.wgsl`: searches the candidates, and computes the E-step and the sums of every tile.
pub const PASS: &str = wgsl!("mixture/cells", "mixture/pass");
/// `mixture/index.wgsl`: sorts means into the cells of their grid.
pub const INDEX: &str = wgsl!("mixture/cells", "mixture/index");

/// Bytes per point: three coordinates of position and three of colour.
const POINT_BYTES: u64 = 24;
/// Bytes per mean in each of two buffers: position and component, or colour and weight.
const MEAN_BYTES: u64 = 16;
pub(super) const RECORD_BYTES: u64 = RECORD_WORDS as u64 * WORD;
/// Number of words before the list of open tiles (tiles left to the CPU). The words hold the number of
/// records and the number of open tiles.
pub(super) const HEAD_WORDS: u64 = 2;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Frame,
    Points,
    Tiles,
    Starts,
    Means,
    Appearance,
    Distances,
    Records,
    Outcome,
    Index,
    Moved,
    Components,
    Places,
    Strips,
}

/// Index of the upload of a frame's points and tiles; `MEAN_UPLOAD` is that of moved means.
pub(super) const FRAME_UPLOAD: usize = 0;
pub(super) const MEAN_UPLOAD: usize = 1;

/// Buffers bound by the pass over a frame. The following constants list the buffers of the kernels that
/// sort means.
pub(super) const RUN: Bindings<Part> = &[
    (0, Part::Frame),
    (1, Part::Points),
    (2, Part::Tiles),
    (3, Part::Starts),
    (4, Part::Means),
    (5, Part::Appearance),
    (6, Part::Distances),
    (7, Part::Records),
    (8, Part::Outcome),
];
pub(super) const RENEW: Bindings<Part> =
    &[(0, Part::Index), (1, Part::Moved), (2, Part::Components)];
pub(super) const COUNT: Bindings<Part> =
    &[(0, Part::Index), (2, Part::Components), (3, Part::Starts), (4, Part::Places)];
pub(super) const ADD: Bindings<Part> = &[(0, Part::Index), (3, Part::Starts), (5, Part::Strips)];
pub(super) const PLACE: Bindings<Part> = &[
    (0, Part::Index),
    (2, Part::Components),
    (3, Part::Starts),
    (4, Part::Places),
    (6, Part::Means),
    (7, Part::Appearance),
];

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PassSizes {
    pub(super) points: u64,
    pub(super) tiles: u64,
    pub(super) means: u64,
    /// Number of means uploaded with the next pass.
    pub(super) moved: u64,
    pub(super) cells: u64,
    pub(super) records: u64,
}

impl TaskPart for Part {
    type Sizes = PassSizes;
    const LABEL: &'static str = "pass over a frame";
    const ALL: &'static [PartRow<Self>] = &[
        (Part::Frame, "settings of a pass", SETTINGS, |_| bytes_of::<Frame>()),
        (Part::Points, "points of a frame", IN, |n| n.points * POINT_BYTES),
        // One more than tiles and cells, for the end of the last one.
        (Part::Tiles, "tiles of a frame", IN, |n| (n.tiles + 1) * WORD),
        (Part::Starts, "cells of means", IN, |n| (n.cells + 1) * WORD),
        (Part::Means, "means of components", Usage::STORAGE, |n| n.means * MEAN_BYTES),
        (Part::Appearance, "colours of components", Usage::STORAGE, |n| n.means * MEAN_BYTES),
        (Part::Distances, "scores of points", OUT, |n| n.points * WORD),
        (Part::Records, "sums of tiles", OUT, |n| n.records * RECORD_BYTES),
        // Cleared before a pass and read back after it.
        (Part::Outcome, "open tiles", OUT.union(Usage::COPY_DST), |n| {
            (HEAD_WORDS + n.tiles) * WORD
        }),
        (Part::Index, "settings of an index", SETTINGS, |_| bytes_of::<Index>()),
        (Part::Moved, "moved means", IN, |n| n.moved * bytes_of::<Mean>()),
        (Part::Components, "components", Usage::STORAGE, |n| n.means * bytes_of::<Mean>()),
        (Part::Places, "positions in cells", Usage::STORAGE, |n| n.means * WORD),
        (Part::Strips, "sums of cells", Usage::STORAGE, |n| {
            (n.cells + 1).div_ceil(STRIP_CELLS.into()) * WORD
        }),
    ];
    const UPLOADS: &'static [&'static str] = &["uploaded points", "uploaded means"];

    fn index(self) -> usize {
        self as usize
    }
}
