//! Memory layouts shared with `points/settings.wgsl`.

use crate::model::scene::points_device::{POINT_WORDS, Seeds, SlotSums};
use crate::model::scene::sums::N_SUMS;
use crate::render::gpu::growing::{
    BufferPart, IN, OUT, PartBuffers, READBACK_STAGING, UPLOAD_STAGING,
};
use bytemuck::{Pod, Zeroable};
use wgpu::BufferUsages as Usage;

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

/// `points/file.wgsl`: inserts seeds into the hash grid.
pub const FILE: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/cells.wgsl"),
    include_str!("../../../../shaders/points/file.wgsl")
);
/// `points/find.wgsl`: finds the nearest seed of every point.
pub const FIND: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/cells.wgsl"),
    include_str!("../../../../shaders/points/find.wgsl")
);
/// `points/sum.wgsl`: sums of the points of every slot.
pub const SUM: &str = concat!(
    include_str!("../../../../shaders/points/settings.wgsl"),
    include_str!("../../../../shaders/points/sum.wgsl")
);

const WORD: u64 = size_of::<u32>() as u64;
/// Bytes per seed: position and chain link, or position and padding.
pub(super) const SEED_BYTES: u64 = 16;

/// Contents of a buffer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Part {
    Settings,
    Points,
    Seeds,
    Heads,
    Nearest,
    Fits,
    References,
    Sums,
    /// Staging buffer for points.
    PointUpload,
    /// Staging buffer for new seeds.
    SeedUpload,
    /// Staging buffer for the slots of points and the slots' seeds.
    FitUpload,
    /// Staging buffer for results.
    Readback,
}

/// All parts in order, with label (also used in messages) and usage.
const PARTS: [(Part, &str, Usage); 12] = [
    (Part::Settings, "settings of points", Usage::UNIFORM.union(Usage::COPY_DST)),
    (Part::Points, "points of a frame", IN),
    (Part::Seeds, "seeds of components", IN),
    (Part::Heads, "cells of seeds", IN),
    (Part::Nearest, "seeds of points", OUT),
    (Part::Fits, "components of points", IN),
    (Part::References, "seeds of sums", IN),
    (Part::Sums, "sums of components", OUT.union(Usage::COPY_DST)),
    (Part::PointUpload, "uploaded points", UPLOAD_STAGING),
    (Part::SeedUpload, "uploaded seeds", UPLOAD_STAGING),
    (Part::FitUpload, "uploaded components", UPLOAD_STAGING),
    (Part::Readback, "sums read back", READBACK_STAGING),
];

/// Sizes of a frame.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PointSizes {
    pub(super) points: u64,
    pub(super) seeds: u64,
    /// Index of the first seed that is not on the GPU yet.
    pub(super) first_new: u64,
    pub(super) buckets: u64,
    /// Number of components with points.
    pub(super) slots: u64,
}

impl PointSizes {
    pub(super) fn bytes(&self, part: Part) -> u64 {
        let Self { points, seeds, first_new, buckets, slots } = *self;
        match part {
            Part::Settings => size_of::<Settings>() as u64,
            Part::Points | Part::PointUpload => points * POINT_WORDS as u64 * WORD,
            Part::Seeds => seeds * SEED_BYTES,
            Part::Heads => buckets * WORD,
            Part::Nearest => points * WORD,
            Part::Fits => points * 2 * WORD,
            Part::References => slots * SEED_BYTES,
            Part::Sums => slots * N_SUMS as u64 * WORD,
            Part::SeedUpload => (seeds - first_new) * SEED_BYTES,
            Part::FitUpload => self.bytes(Part::Fits) + self.bytes(Part::References),
            Part::Readback => self.bytes(Part::Nearest).max(self.bytes(Part::Sums)),
        }
    }
}

/// All buffers, each as large as the largest size requested so far.
pub(super) type Memory = PartBuffers<Part>;

impl BufferPart for Part {
    type Sizes = PointSizes;
    const ALL: &'static [(Self, &'static str, Usage)] = &PARTS;

    fn index(self) -> usize {
        self as usize
    }

    fn bytes(self, sizes: &PointSizes) -> u64 {
        sizes.bytes(self)
    }
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
