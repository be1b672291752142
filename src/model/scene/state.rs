//! Everything a trained scene consists of, as plain columns: what checkpoints hold.

use super::kept::KeptFrame;
use super::photometric::PhotometricState;
use super::sums::N_SUMS;
use super::trajectory::TrackedPose;
use crate::model::splat::exposure::FrameExposure;
use crate::model::splat::pose_log::FramePose;
use bytemuck::{Pod, Zeroable};
use std::cmp::Ordering;

/// What integer sums count: exact in f64 as long as a sum is below [`MAX_SUM`].
// Terms within 7.84 take 18 bits, and 4,096 of them 30: finer quanta would spill rows sooner.
pub const QUANTUM: f64 = 1.0 / 32768.0;

/// From so many points on, a component's sums are in a wide row. With as many more terms within
/// ±7.84 (offsets within ±2.8) a row of 32-bit quanta is still below its limit.
pub const WIDE_POINTS: u32 = 1 << 12;

/// Largest sum of a wide row: 2⁵³ quanta.
pub const MAX_SUM: f64 = (1u64 << 38) as f64;

/// Parts of the structural scale that a seed's share of it is counted in.
pub const WHOLE: u8 = 64;

/// Most steps by which a structural scale grows: 64 times as wide.
// By then a whole seed's share is one part of what it was.
pub const MOST_COARSENED: u32 = 12;

/// A trained scene at a frame boundary. Row `k` of the sums and of the visibility
/// counts is component `k`; it is free if no seed is its.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// World position that seeds are relative to.
    pub origin: [f64; 3],
    /// By how many steps of √2 the structural scale is wider than the one asked for, at most
    /// [`MOST_COARSENED`].
    pub coarsened: u32,
    /// Seeds, world units, in the order they were born in.
    pub seeds: Vec<[f32; 3]>,
    /// By seed the share of the structural scale that points may be from it, in parts of [`WHOLE`]; `None` where all
    /// have the whole.
    pub shares: Option<Vec<u8>>,
    /// By seed its component, where seeds share components; `None` while seed `k` is component
    /// `k`'s.
    pub components: Option<Vec<u32>>,
    /// Sums over everything seen, about the seeds.
    pub sums: StoredSums,
    /// In how many frames each component was seen or seen through.
    pub visibility: Vec<VisibilityCounts>,
    /// How the frames were exposed, in the order they were learnt in, where gains were fitted.
    pub exposures: Vec<FrameExposure>,
    /// How their poses were corrected, in the same order, where poses are not taken for exact.
    pub poses: Vec<FramePose>,
    /// Where the cameras of its frames were found, in the order they were placed in, where poses are
    /// tracked.
    pub trajectory: Vec<TrackedPose>,
    /// What photographs taught, row by component, where splats learn from them.
    pub photometric: Option<PhotometricState>,
    /// The last frames, the oldest first, which are looked at once more where poses are corrected.
    pub kept: Vec<KeptFrame>,
}

/// Order of components that are born in none of their own: by x, then y, then z of their seeds.
pub fn seed_order(a: &[f32; 3], b: &[f32; 3]) -> Ordering {
    // Not `total_cmp`: it tells zeros by their sign, and equal seeds are one component.
    a.partial_cmp(b).unwrap_or(Ordering::Equal)
}

/// In how many frames a component was seen or seen through, and the returns expected of it there:
/// what opacity is found from. Every count stops at its largest value.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct VisibilityCounts {
    /// Returns that it could have given, in 64ths of a pixel.
    pub expected: u32,
    /// Frames that measured a surface where it is.
    pub hits: u16,
    /// Frames that measured something farther through it.
    pub misses: u16,
}

impl VisibilityCounts {
    /// Counts of both together, each stopped at its largest value.
    pub fn plus(self, other: Self) -> Self {
        Self {
            expected: self.expected.saturating_add(other.expected),
            hits: self.hits.saturating_add(other.hits),
            misses: self.misses.saturating_add(other.misses),
        }
    }
}

/// Sums in the order of [`N_SUMS`], offsets in units of the structural scale.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredSums {
    /// Integer quanta, see [`QUANTUM`].
    Mixed {
        /// One row per component; zeros where the sums are in `wide`.
        rows: Vec<[i32; N_SUMS]>,
        /// Rows of components with [`WIDE_POINTS`] points or more, by ascending id.
        wide: Vec<WideRow>,
    },
    /// Sums in f32, which depend on the order of points.
    F32(Vec<[f32; N_SUMS]>),
    /// Sums in f64: the oracle.
    F64(Vec<[f64; N_SUMS]>),
}

/// Sums of one component, whole multiples of [`QUANTUM`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideRow {
    /// Number of the component.
    pub id: u32,
    /// Sums of the component in the order of [`N_SUMS`].
    pub sums: [f64; N_SUMS],
}
