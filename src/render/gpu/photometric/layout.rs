//! Memory layouts shared with `photometric/*.wgsl`.

use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::render::TILE;
use crate::render::cpu::photometric::{
    ImageSums, PackedSplat, PackedSumLocation, PixelRule, RowSubset,
};
use bytemuck::{Pod, Zeroable};

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
