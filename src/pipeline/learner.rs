//! A model that learns, whichever preset it follows.

use super::prepared::Material;
use crate::math::points::Normalization;
use crate::model::appearance::{Appearance, SplatSet};
use crate::model::posterior::ComponentPosterior;
use crate::model::splats::Splat;
use crate::train::candidates::IndexError;
use crate::train::config::TrainConfig;
use crate::train::engine::Engine;
use crate::train::scene::engine::SceneEngine;
use crate::train::trainer::FrameOutcome;
use crate::train::warnings::TrainingWarning;

/// A model that learns.
pub enum Learner {
    /// The published algorithm.
    Paper(Box<PaperLearner>),
    /// Only what a scene needs.
    Scene(SceneEngine),
}

/// A mixture of the published algorithm.
pub struct PaperLearner {
    /// The model.
    pub engine: Engine,
    /// How its posterior becomes splats.
    pub config: TrainConfig,
    /// World to model coordinates.
    pub normalization: Normalization,
}

macro_rules! either {
    ($self:expr, $engine:ident => $body:expr) => {
        match $self {
            Learner::Paper(paper) => {
                let $engine = &paper.engine;
                $body
            }
            Learner::Scene($engine) => $body,
        }
    };
}

impl Learner {
    /// Learns from one frame, whole or not at all. Material of the other preset teaches nothing.
    pub(super) fn train(&mut self, material: &Material) -> Result<FrameOutcome, IndexError> {
        match (self, material) {
            (Self::Paper(paper), Material::Points(points)) => paper.engine.train(points),
            (Self::Scene(engine), Material::Surfaces(frame)) => Ok(engine.train(frame)),
            _ => Ok(FrameOutcome::default()),
        }
    }

    /// Frames learnt.
    pub fn frames(&self) -> u64 {
        either!(self, e => e.frames())
    }

    /// Components, used or not.
    pub fn components(&self) -> usize {
        either!(self, e => e.components())
    }

    /// Components with points.
    pub fn used(&self) -> usize {
        match self {
            Self::Paper(paper) => paper.engine.used(),
            Self::Scene(engine) => engine.used(),
        }
    }

    /// Components that the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        either!(self, e => e.touched())
    }

    /// Bytes the model itself occupies.
    pub fn model_bytes(&self) -> usize {
        either!(self, e => e.model_bytes())
    }

    /// Posterior of a component, normalised coordinates.
    pub fn posterior(&self, component: usize) -> ComponentPosterior {
        either!(self, e => e.posterior(component))
    }

    /// Splats of all components, world units; slot `k` is component `k`, opacity 0 if not drawn.
    pub fn splats(&self) -> SplatSet {
        match self {
            Self::Paper(paper) => paper.engine.splats(&paper.config, &paper.normalization).into(),
            Self::Scene(engine) => engine.splats(),
        }
    }

    /// The same in the order in which checkpoints hold the components.
    pub fn stored_splats(&self) -> SplatSet {
        match self {
            Self::Paper(_) => self.splats(),
            Self::Scene(engine) => engine.stored_splats(),
        }
    }

    /// Splats of the listed components, in their order.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        match self {
            Self::Paper(paper) => {
                paper.engine.splats_of(ids, &paper.config, &paper.normalization).into()
            }
            Self::Scene(engine) => engine.splats_of(ids),
        }
    }

    /// What renderers draw of one component.
    pub fn splat(&self, component: usize) -> (Splat, Appearance) {
        match self {
            Self::Paper(paper) => {
                let posterior = paper.engine.posterior(component);
                let splat = paper.config.conversion.splat(&posterior, &paper.normalization);
                (splat, Appearance::default())
            }
            Self::Scene(engine) => engine.splat(component),
        }
    }

    /// Sums the ELBO of the frames to come by component.
    pub fn start_component_elbo(&mut self) {
        match self {
            Self::Paper(paper) => paper.engine.start_component_elbo(),
            Self::Scene(engine) => engine.start_component_elbo(),
        }
    }

    /// Ends what [`Self::start_component_elbo`] began.
    pub fn stop_component_elbo(&mut self) {
        match self {
            Self::Paper(paper) => paper.engine.stop_component_elbo(),
            Self::Scene(engine) => engine.stop_component_elbo(),
        }
    }

    /// Mean ELBO and number of a component's points of the last frame.
    pub fn component_elbo(&self, component: usize) -> Option<(f64, u32)> {
        either!(self, e => e.component_elbo(component))
    }

    /// Components that [`Self::component_elbo`] knows of, each once.
    pub fn components_with_elbo(&self) -> &[u32] {
        either!(self, e => e.components_with_elbo())
    }

    /// What a user should know about points that found no component.
    pub fn warnings(&self) -> Vec<TrainingWarning> {
        match self {
            Self::Paper(_) => Vec::new(),
            Self::Scene(engine) => engine.lost().warnings(),
        }
    }
}
