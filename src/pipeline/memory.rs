//! What a run will take of the machine's memory, before it is taken.

use super::machine;
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::splat::splats::Splat;
use crate::observation::surface::SurfacePoint;
use crate::train::paper::config::{
    Batch, Candidates, IndexKind, PaperConfig, Precision, StatisticsForm, UpdateWidth,
};
use crate::train::scene::config::{COMPONENT_BYTES, SceneConfig};

/// Bytes of a point in memory: six f32 coordinates.
const POINT_BYTES: usize = 24;
/// Frames in memory at once: trained on, ready, in the making.
const FRAMES_AT_ONCE: usize = 3;
/// Decoded images of a frame and memory of unprojection, per pixel.
const PIXEL_BYTES: usize = 24;
/// A candidate and its responsibility where they are written out.
const PAIR_BYTES: usize = 12;
/// Points of a tile at most.
const TILE_POINTS: usize = 64;
/// Records of a component in a tile, for every point at worst; every thread has room for all, and
/// what grows, grows to three times as many.
const RECORD_BYTES: usize = 3 * 60;
/// The program itself.
const PROGRAM_BYTES: u64 = 30_000_000;
/// Entry of the grid and its copy of colour and weight, cells, and the slots of a thread.
const INDEX_BYTES: usize = 16 + 16 + 8;
const SLOT_BYTES: usize = 8;
/// Entry of the KD-tree and the widened means it is built from.
const TREE_BYTES: usize = 32 + 24;

/// What a component of a scene takes, beside its own bytes, while a checkpoint of it is written: a copy
/// of its sums and seed, its place in their order, and room to grow. Measured on Lego with 96,000 to
/// 616,000 components: the peak grows by 429 bytes a component, 199 of them the model's. The splats of
/// the exported scene are made after that copy is dropped, and are smaller.
const SCENE_COPY_BYTES: usize = 230;
/// Owner, shift and distance of a point.
const SCENE_POINT_BYTES: usize = 16;

/// Bytes that a run is expected to take at most.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Estimate {
    /// Grows with the number of components.
    pub model: u64,
    /// The rest; grows with the size of a frame.
    pub frames: u64,
}

/// A run that would not fit.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "components: expected at most {most}, which the {available_mb} MB of free memory hold, found {found} ({needed_mb} MB); take fewer components or close other programs"
)]
pub struct MemoryError {
    /// Components that would fit.
    pub most: u64,
    /// Components asked for.
    pub found: usize,
    /// Free memory, 10⁶ bytes.
    pub available_mb: u64,
    /// Memory needed, 10⁶ bytes.
    pub needed_mb: u64,
}

impl Estimate {
    /// For frames of `pixels` on `threads` threads.
    pub fn new(config: &PaperConfig, pixels: usize, threads: usize) -> Self {
        let scalar = if config.precision == Precision::F64 { 8 } else { 4 };
        let total = match config.operations.update {
            UpdateWidth::F32 => size_of::<[f32; 16]>(),
            UpdateWidth::Fixed64 => size_of::<[i64; 16]>(),
            UpdateWidth::Fixed128 => size_of::<[i128; 16]>(),
        };
        let tree = if config.index == IndexKind::KdTree { TREE_BYTES } else { 0 };
        let drawn = size_of::<[f64; 7]>();
        let splat = size_of::<Splat>();
        // The start is drawn in f64; a checkpoint holds a copy; the scene is written as splats.
        let copies = drawn.max(splat + N_SUMS * size_of::<i64>() + 7 * scalar);
        let per_component = total
            + 7 * scalar
            + size_of::<f64>()
            + INDEX_BYTES
            + SLOT_BYTES * threads
            + tree
            + copies;
        let per_point = match config.candidates {
            Candidates::Dense => config.components,
            Candidates::Nearest(n) => n.min(config.components),
        };
        let pairs = match (config.statistics, config.batch) {
            (StatisticsForm::Fused, _) => TILE_POINTS * threads,
            (StatisticsForm::Unfused, Batch::Frame) => pixels,
            (StatisticsForm::Unfused, Batch::Points(n)) => n.min(pixels) + TILE_POINTS,
        };
        let of_points = pixels * (FRAMES_AT_ONCE * POINT_BYTES + size_of::<f64>() + PIXEL_BYTES);
        let records = pixels.min(2 * config.components) * RECORD_BYTES * threads;
        let pairs = (pairs as u64).saturating_mul((per_point * PAIR_BYTES) as u64);
        Self {
            model: (config.components as u64).saturating_mul(per_component as u64),
            frames: (PROGRAM_BYTES + (of_points + records) as u64).saturating_add(pairs),
        }
    }

    /// For a scene of as many components as its settings allow.
    pub fn of_scene(config: &SceneConfig, pixels: usize) -> Self {
        let per_component = COMPONENT_BYTES + SCENE_COPY_BYTES;
        let point = size_of::<SurfacePoint>() + size_of::<f32>();
        let of_points = pixels * (FRAMES_AT_ONCE * point + SCENE_POINT_BYTES + PIXEL_BYTES);
        Self {
            model: (config.most as u64).saturating_mul(per_component as u64),
            frames: PROGRAM_BYTES + of_points as u64,
        }
    }

    /// All of it.
    pub fn total(&self) -> u64 {
        self.model.saturating_add(self.frames)
    }

    /// Refuses what the machine has no free memory for, where it says how much it has.
    pub fn check(&self, components: usize) -> Result<(), MemoryError> {
        match machine::available_bytes() {
            Some(available) => self.check_against(components, available),
            None => Ok(()),
        }
    }

    fn check_against(&self, components: usize, available: u64) -> Result<(), MemoryError> {
        if self.total() <= available {
            return Ok(());
        }
        let per_component = (self.model / components.max(1) as u64).max(1);
        Err(MemoryError {
            most: available.saturating_sub(self.frames) / per_component,
            found: components,
            available_mb: available / 1_000_000,
            needed_mb: self.total().div_ceil(1_000_000),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::PaperOverrides;

    #[test]
    fn what_does_not_fit_is_refused_with_what_would() {
        let estimate = |overrides: PaperOverrides| {
            Estimate::new(&PaperConfig::paper().with(&overrides).unwrap(), 640_000, 2)
        };
        let paper = estimate(PaperOverrides::default());
        assert!((50_000_000..300_000_000).contains(&paper.total()), "{paper:?}");
        assert_eq!(paper.check_against(100_000, paper.total()), Ok(()));
        let error = paper.check_against(100_000, paper.total() - 1).unwrap_err();
        assert_eq!((error.found, error.most), (100_000, 99_999));
        let dense = estimate(PaperOverrides {
            candidates: Some(Candidates::Dense),
            statistics: Some(StatisticsForm::Unfused),
            ..PaperOverrides::default()
        });
        assert!(dense.total() > 500_000_000_000, "{dense:?}");
    }
}
