//! One scene trainer behind either form of sums.

use super::config::SceneConfig;
use super::trainer::{Lost, SceneTrainer};
use crate::math::observation::Observation;
use crate::model::appearance::{Appearance, SplatSet};
use crate::model::posterior::ComponentPosterior;
use crate::model::scene::native::NativeRule;
use crate::model::scene::state::SceneState;
use crate::model::splats::Splat;
use crate::train::trainer::FrameOutcome;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use strum::{EnumString, VariantNames};

/// How sums are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SumForm {
    /// Terms in f32, sums in integers: any order of points gives the same bits.
    Mixed,
    /// Terms and sums in f32.
    F32,
    /// All in f64: the oracle.
    F64,
}

/// A scene trainer whose sums take the form chosen at run time.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::observation::{Observation, SurfacePoint};
/// use vbgs_studio::train::scene::{config::SceneConfig, engine::SceneEngine};
///
/// let at = |x| SurfacePoint {
///     position: [x, 0.0, 1.0],
///     normal: [0.0, 0.0, -1.0],
///     direction: [0.0, 0.0, 1.0],
///     ..SurfacePoint::default()
/// };
/// let frame = Observation { points: vec![at(0.0), at(0.05), at(0.5)], ..Observation::empty() };
/// let mut engine = SceneEngine::new(&SceneConfig::fine(0.1), DVec3::ZERO);
/// assert_eq!(engine.train(&frame).points, 3);
/// assert_eq!(engine.used(), 2, "one of them had a seed within 0.1");
/// assert_eq!(engine.posterior(0).count, 2.0);
/// ```
pub enum SceneEngine {
    /// See [`SumForm::Mixed`].
    Mixed(Box<SceneTrainer<i32>>),
    /// See [`SumForm::F32`].
    F32(Box<SceneTrainer<f32>>),
    /// See [`SumForm::F64`].
    F64(Box<SceneTrainer<f64>>),
}

macro_rules! either {
    ($self:expr, $trainer:ident => $body:expr) => {
        match $self {
            SceneEngine::Mixed($trainer) => $body,
            SceneEngine::F32($trainer) => $body,
            SceneEngine::F64($trainer) => $body,
        }
    };
}

impl SceneEngine {
    /// See [`SceneTrainer::new`].
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        match config.sums {
            SumForm::Mixed => Self::Mixed(Box::new(SceneTrainer::new(config, origin))),
            SumForm::F32 => Self::F32(Box::new(SceneTrainer::new(config, origin))),
            SumForm::F64 => Self::F64(Box::new(SceneTrainer::new(config, origin))),
        }
    }

    /// See [`SceneTrainer::restore`].
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        match config.sums {
            SumForm::Mixed => {
                SceneTrainer::restore(config, state, frames).map(|t| Self::Mixed(Box::new(t)))
            }
            SumForm::F32 => {
                SceneTrainer::restore(config, state, frames).map(|t| Self::F32(Box::new(t)))
            }
            SumForm::F64 => {
                SceneTrainer::restore(config, state, frames).map(|t| Self::F64(Box::new(t)))
            }
        }
    }

    /// The scene as it stands.
    pub fn state(&self) -> SceneState {
        either!(self, t => t.state())
    }

    /// See [`SceneTrainer::stored_splats`].
    pub fn stored_splats(&self) -> SplatSet {
        either!(self, t => t.stored_splats())
    }

    /// See [`SceneTrainer::train`].
    pub fn train(&mut self, frame: &Observation) -> FrameOutcome {
        either!(self, t => t.train(frame))
    }

    /// Frames learnt.
    pub fn frames(&self) -> u64 {
        either!(self, t => t.frames())
    }

    /// Slots of components, in use or free.
    pub fn components(&self) -> usize {
        either!(self, t => t.components())
    }

    /// Components in use.
    pub fn used(&self) -> usize {
        either!(self, t => t.used())
    }

    /// Points that found no component so far.
    pub fn lost(&self) -> Lost {
        either!(self, t => t.lost())
    }

    /// Components that the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        either!(self, t => t.touched())
    }

    /// Bytes the model itself occupies.
    pub fn model_bytes(&self) -> usize {
        either!(self, t => t.model_bytes())
    }

    /// See [`SceneTrainer::posterior`].
    pub fn posterior(&self, component: usize) -> ComponentPosterior {
        either!(self, t => t.posterior(component))
    }

    /// Draws components by another rule from now on.
    pub fn set_native(&mut self, rule: NativeRule) {
        either!(self, t => t.set_native(rule));
    }

    /// What renderers draw of a component; an empty slot if nothing.
    pub fn splat(&self, component: usize) -> (Splat, Appearance) {
        either!(self, t => t.splat(component))
    }

    /// What renderers draw of all components; slot `k` is component `k`.
    pub fn splats(&self) -> SplatSet {
        either!(self, t => t.splats())
    }

    /// What renderers draw of the listed components, in their order.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        either!(self, t => t.splats_of(ids))
    }

    /// See [`SceneTrainer::component_elbo`].
    pub fn component_elbo(&self, component: usize) -> Option<(f64, u32)> {
        either!(self, t => t.component_elbo(component))
    }

    /// See [`SceneTrainer::components_with_elbo`].
    pub fn components_with_elbo(&self) -> &[u32] {
        either!(self, t => t.components_with_elbo())
    }

    /// See [`SceneTrainer::start_component_elbo`].
    pub fn start_component_elbo(&mut self) {
        either!(self, t => t.start_component_elbo());
    }

    /// See [`SceneTrainer::stop_component_elbo`].
    pub fn stop_component_elbo(&mut self) {
        either!(self, t => t.stop_component_elbo());
    }
}
