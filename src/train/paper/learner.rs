//! Implements the learner interface for the `paper` preset.

use super::config::{Candidates, PaperConfig, Precision, UpdateWidth};
use super::index::PaperScalar;
use super::init::InitialDraw;
use super::pass::Mixture;
use super::trainer::PaperTrainer;
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::conjugate::statistics::N_SUMS;
use crate::model::inspection::DeviceError;
use crate::model::paper::state::ModelState;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::splats::Splat;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::device_trial::DevicePolicy;
use crate::train::learner::{
    Changed, Component, DeviceUse, LastFrame, Learner, Learns, ModelMemory, Status, TrainingDevice,
};
use crate::train::outcome::{FrameOutcome, MemoryEstimate, PIXEL_BYTES, PROGRAM_BYTES};
use rayon::prelude::*;

// Minimum number of components per parallel task: smaller tasks cost more than they save.
const MIN_SPLATS: usize = 1024;

/// Operations of a learner of the `paper` preset, independent of its precision.
pub trait PaperLearner: Learns<Points<f32>> {
    /// Returns the ELBO of each point of the last frame, nats, in point order. The ELBO is that under
    /// the model used to score the point. It is NaN for points left out.
    fn point_elbo(&self) -> Vec<f64>;

    /// Computes the candidates of each point with their responsibilities, without training on the
    /// points.
    fn responsibilities(&mut self, points: &Points<f32>) -> Vec<Vec<(u32, f64)>>;

    /// Returns the state of the mixture.
    fn state(&self) -> ModelState;

    /// Returns the posteriors of all components, normalised coordinates.
    fn posteriors(&self) -> Vec<ComponentPosterior> {
        (0..self.status().components).map(|k| self.component(k).posterior).collect()
    }
}

struct NormalizedTrainer<R: PaperScalar> {
    trainer: PaperTrainer<R>,
    normalization: Normalization,
    /// Points of the frame in the trainer's precision, if this is not f32.
    widened: Points<R>,
}

impl<R: PaperScalar> NormalizedTrainer<R> {
    fn splat(&self, component: usize) -> Splat {
        let conversion = self.trainer.mixture.config.conversion;
        conversion.splat(&self.trainer.posterior(component), &self.normalization)
    }
}

impl<R: PaperScalar> Learns<Points<f32>> for NormalizedTrainer<R> {
    fn learn(&mut self, points: &Points<f32>) -> Result<FrameOutcome, IndexError> {
        // Inside the thread pool: starting each of a frame's parallel loops from outside would wake threads.
        rayon::scope(|_| self.trainer.train(R::points(points, &mut self.widened)))
    }
}

impl<R: PaperScalar> PaperLearner for NormalizedTrainer<R> {
    fn point_elbo(&self) -> Vec<f64> {
        self.trainer.elbo()
    }

    fn responsibilities(&mut self, points: &Points<f32>) -> Vec<Vec<(u32, f64)>> {
        self.trainer.responsibilities(R::points(points, &mut self.widened))
    }

    fn state(&self) -> ModelState {
        self.trainer.state()
    }
}

impl<R: PaperScalar> Learner for NormalizedTrainer<R> {
    fn status(&self) -> Status {
        let Mixture { model, statistics, .. } = &self.trainer.mixture;
        Status {
            frames: self.trainer.frames,
            components: model.len(),
            used: statistics.used(),
            is_settled: false,
            warnings: Vec::new(),
        }
    }

    fn memory(&self) -> ModelMemory {
        let Mixture { model, statistics, .. } = &self.trainer.mixture;
        // Initial means and weights, and the Dirichlet parameter.
        let of_start = 7 * size_of::<R>() + size_of::<f64>();
        let bytes = model.len() * (of_start + statistics.row_bytes());
        ModelMemory { bytes, texture_bytes: 0 }
    }

    fn last_frame(&self) -> LastFrame<'_> {
        LastFrame {
            changed: Changed::Listed(self.trainer.mixture.statistics.touched()),
            compared_photographs: &[],
            component_elbo: &self.trainer.component_elbo,
        }
    }

    fn component(&self, component: usize) -> Component {
        let posterior = self.trainer.posterior(component);
        Component { posterior, normal: None, photometric_deviations: None }
    }

    fn evidence(&self, component: usize) -> f64 {
        self.trainer.moments(component).count
    }

    fn splats(&self) -> SplatSet {
        let ids = (0..self.trainer.components()).into_par_iter().with_min_len(MIN_SPLATS);
        ids.map(|k| self.splat(k)).collect::<Vec<_>>().into()
    }

    fn splats_of(&self, components: &[u32]) -> SplatSet {
        let ids = components.par_iter().with_min_len(MIN_SPLATS);
        ids.map(|&k| self.splat(k as usize)).collect::<Vec<_>>().into()
    }

    fn add_device(
        &mut self,
        device: TrainingDevice,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        match device {
            TrainingDevice::Passes(device) => {
                let PaperTrainer { passes, mixture, .. } = &mut self.trainer;
                passes.add_device(device, policy, mixture)
            }
            TrainingDevice::Photographs(_) | TrainingDevice::Points(_) => Ok(()),
        }
    }

    fn device_use(&self) -> DeviceUse {
        let passes = self.trainer.passes.usage(&self.trainer.inputs());
        DeviceUse { passes, ..DeviceUse::default() }
    }

    fn component_elbo_mut(&mut self) -> &mut ComponentElbo {
        &mut self.trainer.component_elbo
    }

    fn checkpoint_model(&self) -> StoredModel {
        StoredModel::Mixture {
            normalization: self.normalization,
            hyper: self.trainer.mixture.config.hyper(),
            state: self.trainer.state(),
        }
    }
}

/// Bytes per point: six f32 coordinates.
const POINT_BYTES: usize = 24;
/// Bytes per stored candidate with its responsibility.
const PAIR_BYTES: usize = 12;
const TILE_POINTS: usize = 64;
// Bytes per record of a component in a tile, at worst one per point. Each thread reserves space for
// all records, and buffers grow to three times the size needed.
const RECORD_BYTES: usize = 3 * 60;
/// Bytes of the index per component: grid entry, copy of colour and weight, and cells.
const INDEX_BYTES: usize = 16 + 16 + 8;
const SLOT_BYTES: usize = 8;

impl PaperConfig {
    /// Estimates the peak memory of a run on `threads` threads. Frames have `pixels` pixels; at most
    /// `frames_at_once` frames are in memory.
    pub fn memory(&self, pixels: usize, frames_at_once: usize, threads: usize) -> MemoryEstimate {
        // Only this precision stores means in f64; custom operations widen f32 means.
        let scalar = if self.precision == Precision::F64 { 8 } else { 4 };
        let total = match self.operations.update {
            UpdateWidth::Fixed64 => size_of::<[i64; 16]>(),
            UpdateWidth::Fixed128 => size_of::<[i128; 16]>(),
        };
        let drawn = size_of::<[f64; 7]>();
        let splat = size_of::<Splat>();
        // Initial means are drawn in f64; checkpoints copy the model; the scene is exported as splats.
        let copies = drawn.max(splat + N_SUMS * size_of::<i64>() + 7 * scalar);
        let per_component =
            total + 7 * scalar + size_of::<f64>() + INDEX_BYTES + SLOT_BYTES * threads + copies;
        let per_point = match self.candidates {
            Candidates::Dense => self.components,
            Candidates::Nearest(n) => n.min(self.components),
        };
        let of_points = pixels * (frames_at_once * POINT_BYTES + size_of::<f64>() + PIXEL_BYTES);
        let records = pixels.min(2 * self.components) * RECORD_BYTES * threads;
        let pairs =
            ((TILE_POINTS * threads) as u64).saturating_mul((per_point * PAIR_BYTES) as u64);
        MemoryEstimate {
            model: (self.components as u64).saturating_mul(per_component as u64),
            frames: (PROGRAM_BYTES + (of_points + records) as u64).saturating_add(pairs),
            textures: 0,
        }
    }
}

/// Creates an untrained mixture in the precision of `config`. Points are normalised by
/// `normalization`.
///
/// # Errors
/// [`IndexError`] if the initial means cannot be indexed.
///
/// ```
/// use vbgs_studio::math::measured_pixel::Normalization;
/// use vbgs_studio::observation::points::Points;
/// use vbgs_studio::train::paper::{config::{PaperOverrides, PaperConfig}, init::InitialDraw, learner};
///
/// let config = PaperConfig::paper().with(&PaperOverrides { components: Some(50), ..Default::default() })?;
/// let mut mixture = learner::begin(&config, &InitialDraw::random(50, 0), Normalization::IDENTITY)?;
/// let outcome = mixture.learn(&Points::from_rows(&[[0.1; 6], [0.2; 6]]))?;
/// assert_eq!(outcome.points, 2);
/// assert!(mixture.status().used >= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn begin(
    config: &PaperConfig,
    draw: &InitialDraw,
    normalization: Normalization,
) -> Result<Box<dyn PaperLearner>, IndexError> {
    Ok(match config.precision {
        Precision::F64 => in_world(PaperTrainer::<f64>::new(config, draw)?, normalization),
        // Custom operations widen single steps; points and means stay f32.
        _ => in_world(PaperTrainer::<f32>::new(config, draw)?, normalization),
    })
}

/// Restores a mixture of the same configuration, as it was after `frames` frames.
///
/// # Errors
/// [`IndexError`] if the initial means cannot be indexed.
pub fn restore(
    config: &PaperConfig,
    state: ModelState,
    frames: u64,
    normalization: Normalization,
) -> Result<Box<dyn PaperLearner>, IndexError> {
    Ok(match config.precision {
        Precision::F64 => {
            in_world(PaperTrainer::<f64>::restore(config, state, frames)?, normalization)
        }
        _ => in_world(PaperTrainer::<f32>::restore(config, state, frames)?, normalization),
    })
}

fn in_world<R: PaperScalar>(
    trainer: PaperTrainer<R>,
    normalization: Normalization,
) -> Box<dyn PaperLearner> {
    Box::new(NormalizedTrainer { trainer, normalization, widened: Points::new() })
}
