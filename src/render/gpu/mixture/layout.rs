//! Memory layouts shared with `mixture/pass.wgsl` and `mixture/index.wgsl`.

use crate::model::paper::mixture_device::{GridShape, MAX_DEVICE_CANDIDATES, PassRule};
use bytemuck::{Pod, Zeroable};

/// `Index` of `index.wgsl`.
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

/// `Mean` of `index.wgsl`.
#[derive(Clone, Copy, Debug, Default, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Mean {
    pub(super) position: [f32; 3],
    pub(super) weight: f32,
    pub(super) color: [f32; 3],
    pub(super) id: u32,
}

/// `Frame` of `pass.wgsl`.
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
