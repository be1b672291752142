//! Memory layouts shared with `points/settings.wgsl`.

use crate::model::scene::points_device::{Seeds, SlotSums};
use bytemuck::{Pod, Zeroable};

/// Factor by which the search radius exceeds the structural scale, to allow for rounding of distances.
const MARGIN: f32 = 1.0 + 1e-5;

/// `Settings` of `settings.wgsl`.
#[derive(Clone, Copy, Debug, Pod, Zeroable)]
#[repr(C)]
pub(super) struct Settings {
    gain: [f32; 3],
    per_h: f32,
    weight: f32,
    minus_zero: f32,
    per_cell: f32,
    max_cells: f32,
    radius: f32,
    limit: f32,
    n_points: u32,
    first_seed: u32,
    n_seeds: u32,
    bucket_mask: u32,
    /// Padding to the size required for uniforms.
    rest: [u32; 2],
}

impl Settings {
    /// Settings of a search.
    pub(super) fn search(seeds: &Seeds<'_>) -> Self {
        Self {
            minus_zero: -0.0,
            per_cell: seeds.per_cell,
            max_cells: seeds.max_cells,
            radius: seeds.h * MARGIN,
            limit: seeds.h * seeds.h,
            n_seeds: seeds.positions.len() as u32,
            ..Self::zeroed()
        }
    }

    /// Adds the sizes of a frame: `n_points` points, new seeds from `first_seed` on, and the number of hash
    /// buckets, a power of two.
    pub(super) fn of_frame(self, n_points: u64, first_seed: u64, buckets: u64) -> Self {
        let [n_points, first_seed, bucket_mask] =
            [n_points, first_seed, buckets.saturating_sub(1)].map(|n| n as u32);
        Self { n_points, first_seed, bucket_mask, ..self }
    }

    /// Settings of sums over points.
    pub(super) fn sums(asked: &SlotSums<'_>) -> Self {
        Self {
            gain: asked.gain,
            per_h: asked.per_h,
            weight: asked.weight,
            minus_zero: -0.0,
            n_points: asked.points.len() as u32,
            ..Self::zeroed()
        }
    }
}
