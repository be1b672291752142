//! Implementation of the trainer traits for the scene preset.

use super::SceneTrainer;
use crate::model::attributes::StoredModel;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::scene::points_device::PointsDevice;
use crate::model::scene::splat_rule::SplatRule;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::observation::surface::Observation;
use crate::render::cpu::photometric::PhotometricComparer;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::device_trial::{ComparerUse, DevicePolicy, PassUse};
use crate::train::learner::{Changed, Learner, Learns};
use crate::train::outcome::{ComparedPhotograph, FrameOutcome, TrainingWarning};
use crate::train::scene::engine::SceneLearner;
use crate::train::timing::{SCENE_STAGES, TrainStage};
use glam::DVec3;
use rayon::prelude::*;

impl Learns<Observation> for SceneTrainer {
    fn learn(&mut self, frame: &Observation) -> Result<FrameOutcome, IndexError> {
        Ok(self.train(frame))
    }

    fn revisit_photograph(&mut self, frame: &Observation) -> FrameOutcome {
        self.train_on_photograph(frame)
    }
}

impl SceneLearner for SceneTrainer {
    fn set_splat_rule(&mut self, rule: SplatRule) {
        self.config.splat_rule = rule;
        // It was computed from pictures drawn with the previous rule.
        self.settled = None;
    }
}

impl Learner for SceneTrainer {
    fn stages(&self) -> &'static [TrainStage] {
        &SCENE_STAGES
    }

    fn frames(&self) -> u64 {
        self.frames
    }

    /// Number of rows of sums, used or free.
    fn components(&self) -> usize {
        self.component_sums.len()
    }

    fn used(&self) -> usize {
        self.components.used()
    }

    fn changed(&self) -> Changed<'_> {
        if self.has_changed_all { Changed::All } else { Changed::Listed(&self.touched) }
    }

    fn changes_unlisted_components(&self) -> bool {
        true
    }

    fn model_bytes(&self) -> usize {
        self.component_sums.bytes()
            + self.grid.bytes()
            + self.components.bytes()
            + self.photometric.state().bytes()
    }

    /// World units relative to the scene's origin, colours normalised. The prior mean is the seed
    /// (`model.md`, Quirks of the reference).
    fn posterior(&self, id: usize) -> ComponentPosterior {
        let moments = self.sums(id).moments();
        // Computed about the seed, so that the prior pulls towards it and not to the origin, then moved.
        let mut posterior = ComponentPosterior::new(&self.hyper, DVec3::ZERO, &moments);
        posterior.mean_space += self.seed(id);
        posterior
    }

    fn photometric_deviations(&self, id: usize) -> Option<PhotometricDeviations> {
        PhotometricDeviations::of(self.drawn_state(), id)
    }

    fn compared_photographs(&self) -> &[ComparedPhotograph] {
        &self.compared
    }

    fn settle(&mut self) -> bool {
        self.settle_photographs()
    }

    fn is_settled(&self) -> bool {
        self.settled.is_some()
    }

    fn compare_on(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.photometric.compare_on(comparer, policy);
    }

    fn fit_on(&mut self, device: Box<dyn PointsDevice>, policy: DevicePolicy) {
        self.fits.add_device(device, policy);
    }

    fn point_use(&self) -> Option<PassUse> {
        Some(self.fits.used())
    }

    fn comparer_use(&self) -> Option<ComparerUse> {
        self.config.photometric.is_some().then(|| self.photometric.comparer_use())
    }

    fn normal(&self, id: usize) -> Option<DVec3> {
        self.sums(id).normal.try_normalize()
    }

    fn splat(&self, id: usize) -> (Splat, Appearance) {
        let (splat, appearance) =
            self.drawn_state().splat(id).unwrap_or_else(|| self.splat_of_points(id));
        (splat, Appearance { observed: self.component_sums.observed_cone(id), ..appearance })
    }

    fn splats(&self) -> SplatSet {
        self.every_splat()
    }

    fn splats_of(&self, ids: &[u32]) -> SplatSet {
        let splats = ids.par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|&id| self.splat(id as usize)).unzip();
        self.set_of(splats, appearance)
    }

    fn component_elbo(&self) -> &ComponentElbo {
        &self.component_elbo
    }

    fn component_elbo_mut(&mut self) -> &mut ComponentElbo {
        &mut self.component_elbo
    }

    fn warnings(&self) -> Vec<TrainingWarning> {
        let super::UnassignedPoints { budget, reach } = self.unassigned;
        let budget = (budget > 0).then_some(TrainingWarning::OverBudget { points: budget });
        let is_coarser = self.coarsened > 0;
        let (asked, scale) = (self.scale, round(self.config.h));
        let coarsened =
            is_coarser.then_some(TrainingWarning::Coarsened { requested: asked, scale });
        let reach = (reach > 0).then_some(TrainingWarning::TooFarFromOrigin { points: reach });
        let splats = self.photometric.repaired();
        let repaired = (splats > 0).then_some(TrainingWarning::PrecisionReset { splats });
        budget.into_iter().chain(coarsened).chain(reach).chain(repaired).collect()
    }

    fn checkpoint_model(&self) -> StoredModel {
        StoredModel::Scene(self.state())
    }
}

/// Rounds to four significant digits.
fn round(value: f64) -> f64 {
    format!("{value:.3e}").parse().unwrap_or(value)
}
