//! Memory layouts shared with `points/settings.wgsl`.

use crate::model::scene::points_device::{POINT_WORDS, Seeds, SlotSums};
use crate::model::scene::sums::N_SUMS;
use crate::render::gpu::constants::wgsl;
use crate::render::gpu::task::{Bindings, IN, OUT, PartRow, SETTINGS, TaskPart, WORD, bytes_of};
use bytemuck::{Pod, Zeroable};
use wgpu::BufferUsages as Usage;

// Factor by which the search radius exceeds the structural scale, to allow for rounding of distances.
const MARGIN: f32 = 1.0 + 1e-5;

/// Settings of all kernels: `Settings` of `settings.wgsl`.
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

    /// Sets the sizes of a frame: `n_points` points, new seeds from index `first_seed` on, and
    /// `buckets` hash buckets (a power of two).
    pub(super) fn of_frame(self, n_points: u64, first_seed: u64, buckets: u64) -> Self {
        let [n_points, first_seed, bucket_mask] =
            [n_points, first_seed, buckets.saturating_sub(1)].map(|n| n as u32);
        Self { n_points, first_seed, bucket_mask, ..self }
    }

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

/// `points/file.wgsl`: inserts seeds (points at which components were created) into the hash grid.
pub const FILE: &str = wgsl!("points/settings", "points/cells", "points/file");
/// `points/find.wgsl`: finds the nearest seed of every point.
pub const FIND: &str = wgsl!("points/settings", "points/cells", "points/find");
/// `points/sum.wgsl`: sums the points of every slot, that is, of every component with points.
pub const SUM: &str = wgsl!("points/settings", "points/sum");

// Bytes per seed: position and chain link, or position and padding.
pub(super) const SEED_BYTES: u64 = 16;

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
}

/// Index of the upload of points. The following constants are the indices of two other uploads: new
/// seeds, and the slots of the points with the slots' seeds.
pub(super) const POINT_UPLOAD: usize = 0;
pub(super) const SEED_UPLOAD: usize = 1;
pub(super) const FIT_UPLOAD: usize = 2;

/// Buffers bound by the kernel that inserts seeds. `FOUND` and `SUMMED` list the buffers of the kernels
/// that search and sum.
pub(super) const FILED: Bindings<Part> = &[(0, Part::Settings), (2, Part::Seeds), (3, Part::Heads)];
pub(super) const FOUND: Bindings<Part> = &[
    (0, Part::Settings),
    (1, Part::Points),
    (2, Part::Seeds),
    (3, Part::Heads),
    (4, Part::Nearest),
];
pub(super) const SUMMED: Bindings<Part> = &[
    (0, Part::Settings),
    (1, Part::Points),
    (2, Part::Fits),
    (3, Part::References),
    (4, Part::Sums),
];

#[derive(Clone, Copy, Debug, Default)]
pub(super) struct PointSizes {
    pub(super) points: u64,
    pub(super) seeds: u64,
    pub(super) buckets: u64,
    /// Number of components with points in the frame.
    pub(super) slots: u64,
}

impl TaskPart for Part {
    type Sizes = PointSizes;
    const LABEL: &'static str = "fit of points";
    const ALL: &'static [PartRow<Self>] = &[
        (Part::Settings, "settings of points", SETTINGS, |_| bytes_of::<Settings>()),
        (Part::Points, "points of a frame", IN, |n| n.points * bytes_of::<[u32; POINT_WORDS]>()),
        (Part::Seeds, "seeds of components", IN, |n| n.seeds * SEED_BYTES),
        (Part::Heads, "cells of seeds", IN, |n| n.buckets * WORD),
        (Part::Nearest, "seeds of points", OUT, |n| n.points * WORD),
        (Part::Fits, "components of points", IN, |n| n.points * 2 * WORD),
        (Part::References, "seeds of sums", IN, |n| n.slots * SEED_BYTES),
        // Cleared before a run and read back after it.
        (Part::Sums, "sums of components", OUT.union(Usage::COPY_DST), |n| {
            n.slots * bytes_of::<[i32; N_SUMS]>()
        }),
    ];
    const UPLOADS: &'static [&'static str] =
        &["uploaded points", "uploaded seeds", "uploaded components"];

    fn index(self) -> usize {
        self as usize
    }
}
