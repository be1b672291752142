//! Memory estimate of the `paper` preset.

use super::config::{
    Batch, Candidates, IndexKind, PaperConfig, Precision, StatisticsForm, UpdateWidth,
};
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::splat::splats::Splat;
use crate::train::memory::{MemoryEstimate, PIXEL_BYTES, PROGRAM_BYTES};

/// Bytes of a point: six f32 coordinates.
const POINT_BYTES: usize = 24;
/// Bytes of a stored candidate with its responsibility.
const PAIR_BYTES: usize = 12;
/// Maximum number of points in a tile.
const TILE_POINTS: usize = 64;
/// Bytes per record of a component in a tile, at worst one per point. Each thread reserves space for
/// all records, and buffers grow to three times the size needed.
const RECORD_BYTES: usize = 3 * 60;
/// Grid entry, its copy of colour and weight, and cells.
const INDEX_BYTES: usize = 16 + 16 + 8;
const SLOT_BYTES: usize = 8;
/// KD-tree entry and the f64 means it is built from.
const TREE_BYTES: usize = 32 + 24;

impl PaperConfig {
    /// Estimates the maximum memory of a run with frames of `pixels` pixels, `frames_at_once` of them in
    /// memory, on `threads` threads.
    pub fn memory(&self, pixels: usize, frames_at_once: usize, threads: usize) -> MemoryEstimate {
        let scalar = if self.precision == Precision::F64 { 8 } else { 4 };
        let total = match self.operations.update {
            UpdateWidth::F32 => size_of::<[f32; 16]>(),
            UpdateWidth::Fixed64 => size_of::<[i64; 16]>(),
            UpdateWidth::Fixed128 => size_of::<[i128; 16]>(),
        };
        let tree = if self.index == IndexKind::KdTree { TREE_BYTES } else { 0 };
        let drawn = size_of::<[f64; 7]>();
        let splat = size_of::<Splat>();
        // Initial means are drawn in f64; checkpoints copy the model; the scene is exported as splats.
        let copies = drawn.max(splat + N_SUMS * size_of::<i64>() + 7 * scalar);
        let per_component = total
            + 7 * scalar
            + size_of::<f64>()
            + INDEX_BYTES
            + SLOT_BYTES * threads
            + tree
            + copies;
        let per_point = match self.candidates {
            Candidates::Dense => self.components,
            Candidates::Nearest(n) => n.min(self.components),
        };
        let pairs = match (self.statistics, self.batch) {
            (StatisticsForm::Fused, _) => TILE_POINTS * threads,
            (StatisticsForm::Unfused, Batch::Frame) => pixels,
            (StatisticsForm::Unfused, Batch::Points(n)) => n.min(pixels) + TILE_POINTS,
        };
        let of_points = pixels * (frames_at_once * POINT_BYTES + size_of::<f64>() + PIXEL_BYTES);
        let records = pixels.min(2 * self.components) * RECORD_BYTES * threads;
        let pairs = (pairs as u64).saturating_mul((per_point * PAIR_BYTES) as u64);
        MemoryEstimate {
            model: (self.components as u64).saturating_mul(per_component as u64),
            frames: (PROGRAM_BYTES + (of_points + records) as u64).saturating_add(pairs),
        }
    }
}
