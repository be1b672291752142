//! What the CPU and `mixture/pass.wgsl` share byte for byte.

use crate::model::paper::mixture_device::{MAX_DEVICE_CANDIDATES, PassRule};
use bytemuck::{Pod, Zeroable};

/// Where the cells of the means are.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct MeanShape {
    pub(super) lo: [f32; 3],
    pub(super) cell: f32,
    pub(super) per_unit: f32,
    pub(super) dims: [usize; 3],
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
        means: &MeanShape,
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
            open_gap: rule.open_gap,
            minus_zero: -0.0,
            candidates: rule.candidates as u32,
            n_points: n_points as u32,
            n_tiles: n_tiles as u32,
            room: room as u32,
            with_sums: u32::from(with_sums),
        }
    }
}
