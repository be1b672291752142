//! One trainer behind either precision.

use super::config::{PaperConfig, Precision};
use super::init::InitialDraw;
use super::trainer::PaperTrainer;
use crate::math::normalization::Normalization;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::paper::state::ModelState;
use crate::model::splat::splats::Splat;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;
use crate::train::outcome::FrameOutcome;
use rayon::prelude::*;

/// A trainer whose precision was chosen at run time.
///
/// ```
/// use vbgs_studio::observation::points::Points;
/// use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides};
/// use vbgs_studio::train::paper::engine::PaperEngine;
/// use vbgs_studio::train::paper::init::InitialDraw;
///
/// let overrides = PaperOverrides { components: Some(50), ..Default::default() };
/// let config = PaperConfig::paper().with(&overrides)?;
/// let mut engine = PaperEngine::new(&config, &InitialDraw::random(50, 0))?;
/// let outcome = engine.train(&Points::from_rows(&[[0.1; 6], [0.2; 6]]))?;
/// assert_eq!(outcome.points, 2);
/// assert!(engine.used() >= 1);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub enum PaperEngine {
    /// The oracle, and memory for its points.
    F64(Box<PaperTrainer<f64>>, Points<f64>),
    /// f32 points and means.
    Mixed(Box<PaperTrainer<f32>>),
}

macro_rules! either {
    ($self:expr, $trainer:ident => $body:expr) => {
        match $self {
            PaperEngine::F64($trainer, _) => $body,
            PaperEngine::Mixed($trainer) => $body,
        }
    };
}

impl PaperEngine {
    /// A model that has seen nothing.
    pub fn new(config: &PaperConfig, draw: &InitialDraw) -> Result<Self, IndexError> {
        Ok(match config.precision {
            Precision::F64 => Self::F64(Box::new(PaperTrainer::new(config, draw)?), Points::new()),
            _ => Self::Mixed(Box::new(PaperTrainer::new(config, draw)?)),
        })
    }

    /// Learns from one frame, whole or not at all (see [`PaperTrainer::train`]).
    pub fn train(&mut self, points: &Points<f32>) -> Result<FrameOutcome, IndexError> {
        match self {
            Self::F64(trainer, wide) => {
                points.cast_into(wide);
                trainer.train(wide)
            }
            Self::Mixed(trainer) => trainer.train(points),
        }
    }

    /// A model that goes on where another, configured alike, stopped after `frames` frames.
    pub fn restore(
        config: &PaperConfig,
        state: ModelState,
        frames: u64,
    ) -> Result<Self, IndexError> {
        Ok(match config.precision {
            Precision::F64 => {
                Self::F64(Box::new(PaperTrainer::restore(config, state, frames)?), Points::new())
            }
            _ => Self::Mixed(Box::new(PaperTrainer::restore(config, state, frames)?)),
        })
    }

    /// The model as it stands.
    pub fn state(&self) -> ModelState {
        either!(self, t => t.state())
    }

    /// Frames learnt; names the random numbers of the next reassignment.
    pub fn frames(&self) -> u64 {
        either!(self, t => t.frames())
    }

    /// ELBO of every point of the last frame under the model it was scored with, point order; NaN
    /// for points that were left out.
    pub fn elbo(&self) -> Vec<f64> {
        either!(self, t => t.elbo())
    }

    /// See [`PaperTrainer::start_component_elbo`].
    pub fn start_component_elbo(&mut self) {
        either!(self, t => t.start_component_elbo());
    }

    /// See [`PaperTrainer::stop_component_elbo`].
    pub fn stop_component_elbo(&mut self) {
        either!(self, t => t.stop_component_elbo());
    }

    /// See [`PaperTrainer::component_elbo`].
    pub fn component_elbo(&self, component: usize) -> Option<(f64, u32)> {
        either!(self, t => t.component_elbo(component))
    }

    /// See [`PaperTrainer::components_with_elbo`].
    pub fn components_with_elbo(&self) -> &[u32] {
        either!(self, t => t.components_with_elbo())
    }

    /// Per point its candidates and their responsibilities, without learning from it.
    pub fn responsibilities(&mut self, points: &Points<f32>) -> Vec<Vec<(u32, f64)>> {
        match self {
            Self::F64(trainer, wide) => {
                points.cast_into(wide);
                trainer.responsibilities(wide)
            }
            Self::Mixed(trainer) => trainer.responsibilities(points),
        }
    }

    /// Components, used or not.
    pub fn components(&self) -> usize {
        either!(self, t => t.components())
    }

    /// Components with `N_k > 0`.
    pub fn used(&self) -> usize {
        either!(self, t => t.used())
    }

    /// Posterior of a component, normalised coordinates.
    pub fn posterior(&self, component: usize) -> ComponentPosterior {
        either!(self, t => t.posterior(component))
    }

    /// Components whose statistics the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        either!(self, t => t.touched())
    }

    /// Bytes the model itself occupies.
    pub fn model_bytes(&self) -> usize {
        either!(self, t => t.model_bytes())
    }

    /// Splats of all components, world units; slot `k` is component `k`, opacity 0 if not drawn.
    pub fn splats(&self, config: &PaperConfig, normalization: &Normalization) -> Vec<Splat> {
        let splat = |k| config.conversion.splat(&self.posterior(k), normalization);
        (0..self.components()).into_par_iter().with_min_len(1024).map(splat).collect()
    }

    /// Splats of the listed components, in their order.
    pub fn splats_of(
        &self,
        ids: &[u32],
        config: &PaperConfig,
        normalization: &Normalization,
    ) -> Vec<Splat> {
        let splat = |&k: &u32| config.conversion.splat(&self.posterior(k as usize), normalization);
        ids.par_iter().with_min_len(1024).map(splat).collect()
    }
}
