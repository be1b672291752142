//! Implements the learner interface for the `paper` preset.

use super::scalar::PaperScalar;
use super::trainer::PaperTrainer;
use crate::math::normalization::Normalization;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::paper::state::ModelState;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::model::stored::StoredModel;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::device_trial::DevicePolicy;
use crate::train::learner::{Changed, Learner, Learns};
use crate::train::outcome::FrameOutcome;
use crate::train::pass_use::PassUse;
use crate::train::stages::{PAPER_STAGES, TrainStage};
use crate::train::warnings::TrainingWarning;
use rayon::prelude::*;

/// Minimum number of components per parallel task: smaller tasks cost more than they save.
const MIN_SPLATS: usize = 1024;

/// Operations specific to the `paper` preset, independent of precision.
pub trait PaperLearner: Learns<Points<f32>> {
    /// ELBO of each point of the last frame under the model that scored it, nats, in point order; NaN for
    /// points left out.
    fn point_elbo(&self) -> Vec<f64>;

    /// Computes candidates and responsibilities of each point, without training on it.
    fn responsibilities(&mut self, points: &Points<f32>) -> Vec<Vec<(u32, f64)>>;

    /// Returns the state of the mixture.
    fn state(&self) -> ModelState;
}

/// A trainer with the normalisation of its points.
pub(super) struct NormalizedTrainer<R: PaperScalar> {
    pub trainer: PaperTrainer<R>,
    pub normalization: Normalization,
    /// Points of the frame converted to the trainer's precision, if it differs.
    pub widened: Points<R>,
}

impl<R: PaperScalar> Learns<Points<f32>> for NormalizedTrainer<R> {
    fn learn(&mut self, points: &Points<f32>) -> Result<FrameOutcome, IndexError> {
        self.trainer.train(R::points(points, &mut self.widened))
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
    fn stages(&self) -> &'static [TrainStage] {
        &PAPER_STAGES
    }

    fn frames(&self) -> u64 {
        self.trainer.frames()
    }

    fn components(&self) -> usize {
        self.trainer.components()
    }

    fn used(&self) -> usize {
        self.trainer.used()
    }

    fn changed(&self) -> Changed<'_> {
        Changed::Listed(self.trainer.changed_components())
    }

    fn changes_unlisted_components(&self) -> bool {
        false
    }

    fn model_bytes(&self) -> usize {
        self.trainer.model_bytes()
    }

    fn posterior(&self, component: usize) -> ComponentPosterior {
        self.trainer.posterior(component)
    }

    fn splat(&self, component: usize) -> (Splat, Appearance) {
        let conversion = self.trainer.config().conversion;
        let splat = conversion.splat(&self.posterior(component), &self.normalization);
        (splat, Appearance::default())
    }

    fn splats(&self) -> SplatSet {
        let ids = (0..self.components()).into_par_iter().with_min_len(MIN_SPLATS);
        ids.map(|k| self.splat(k).0).collect::<Vec<_>>().into()
    }

    fn splats_of(&self, components: &[u32]) -> SplatSet {
        let ids = components.par_iter().with_min_len(MIN_SPLATS);
        ids.map(|&k| self.splat(k as usize).0).collect::<Vec<_>>().into()
    }

    fn compute_on(
        &mut self,
        device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        self.trainer.compute_on(device, policy)
    }

    fn pass_use(&self) -> Option<PassUse> {
        self.trainer.pass_use()
    }

    fn component_elbo(&self) -> &ComponentElbo {
        self.trainer.component_elbo()
    }

    fn component_elbo_mut(&mut self) -> &mut ComponentElbo {
        self.trainer.component_elbo_mut()
    }

    fn warnings(&self) -> Vec<TrainingWarning> {
        Vec::new()
    }

    fn checkpoint_model(&self) -> StoredModel {
        StoredModel::Mixture {
            normalization: self.normalization,
            hyper: self.trainer.config().hyper(),
            state: self.trainer.state(),
        }
    }
}
