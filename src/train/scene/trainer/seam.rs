//! Implementation of the trainer traits for the scene preset.

use super::budget::UnassignedPoints;
use super::scene::Scene;
use super::{FrameClock, SceneTrainer};
use crate::model::attributes::StoredModel;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::inspection::DeviceError;
use crate::model::scene::photometric::PhotometricDeviations;
use crate::model::scene::splat_rule::SplatRule;
use crate::model::splat::appearance::{Appearance, SplatSet};
use crate::model::splat::splats::Splat;
use crate::observation::surface::Observation;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::device_trial::DevicePolicy;
use crate::train::learner::{
    Component, DeviceUse, LastFrame, Learner, Learns, ModelMemory, Status, TrainingDevice,
};
use crate::train::outcome::{FrameOutcome, TrainingWarning};
use crate::train::timing::SceneStage;
use glam::DVec3;
use rayon::prelude::*;

impl Learns<Observation> for SceneTrainer {
    fn learn(&mut self, frame: &Observation) -> Result<FrameOutcome, IndexError> {
        Ok(self.train(frame))
    }

    fn revisit_photograph(&mut self, frame: &Observation) -> FrameOutcome {
        let mut clock = FrameClock::start();
        self.changes.restart(self.photographs.resume());
        rayon::scope(|_| self.revisit(frame, &mut clock));
        FrameOutcome { ms: clock.finish(), ..FrameOutcome::default() }
    }
}

impl Learner for SceneTrainer {
    fn status(&self) -> Status {
        let Scene { sums, seeds, frames, .. } = &self.scene;
        Status {
            frames: *frames,
            // Rows of sums, used or free.
            components: sums.len(),
            used: seeds.components.used(),
            is_settled: self.photographs.settled.is_some(),
            warnings: self.warnings(),
        }
    }

    fn memory(&self) -> ModelMemory {
        let (Scene { sums, seeds, .. }, state) = (&self.scene, &self.photographs.learner.state);
        let texture_bytes = state.texture_bytes();
        let bytes = sums.bytes() + seeds.bytes() + state.splat_bytes() + texture_bytes;
        ModelMemory { bytes, texture_bytes }
    }

    fn last_frame(&self) -> LastFrame<'_> {
        LastFrame {
            changed: self.changes.get(),
            compared_photographs: &self.photographs.compared,
            component_elbo: &self.component_elbo,
        }
    }

    /// Returns posterior, normal and photometric deviations of a component, in world units relative to
    /// the scene's origin. Colours are normalised. The prior mean is the component's seed (`model.md`,
    /// Quirks of the reference).
    fn component(&self, id: usize) -> Component {
        let sums = self.scene.sums_of(id);
        // Computed about the seed, so that the prior pulls towards it and not to the origin, then moved.
        let mut posterior =
            ComponentPosterior::new(&self.scene.hyper, DVec3::ZERO, &sums.moments());
        posterior.mean_space += self.scene.seed(id);
        Component {
            posterior,
            normal: sums.normal.try_normalize(),
            photometric_deviations: PhotometricDeviations::of(self.photographs.drawn(), id),
        }
    }

    fn evidence(&self, id: usize) -> f64 {
        self.scene.sums.plane_sums(id).0
    }

    fn splats(&self) -> SplatSet {
        self.set_of((0..self.scene.sums.len()).into_par_iter())
    }

    fn splats_of(&self, ids: &[u32]) -> SplatSet {
        self.set_of(ids.par_iter().map(|&id| id as usize))
    }

    fn settle(&mut self) -> bool {
        let is_new = self.settle_photographs();
        if is_new {
            self.changes.add_all();
        }
        is_new
    }

    fn add_device(
        &mut self,
        device: TrainingDevice,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        match device {
            TrainingDevice::Photographs(device) => {
                self.photographs.learner.comparers.add(device, policy);
            }
            TrainingDevice::Points(device) => self.points.fits.add_device(device, policy),
            TrainingDevice::Passes(_) => {}
        }
        Ok(())
    }

    fn device_use(&self) -> DeviceUse {
        let is_photometric = self.scene.config.photometric.is_some();
        DeviceUse {
            photographs: is_photometric.then(|| self.photographs.learner.comparers.used()),
            passes: None,
            points: Some(self.points.fits.used()),
        }
    }

    fn component_elbo_mut(&mut self) -> &mut ComponentElbo {
        &mut self.component_elbo
    }

    fn checkpoint_model(&self) -> StoredModel {
        StoredModel::Scene(self.state())
    }
}

impl SceneTrainer {
    fn revisit(&mut self, frame: &Observation, clock: &mut FrameClock) {
        let placed = self.poses.align(&self.scene, frame, &mut self.points.owners);
        clock.lap(SceneStage::Pose);
        let points = placed.points(frame);
        // Without sums a frame says nothing about the time of a fit.
        self.points.fits.begin_untimed_frame();
        self.points.assign(&self.scene, points);
        let gain = self.points.gain(&self.scene, points, frame.point_weight);
        let is_outlier = self.is_outlier(frame, &placed, gain);
        clock.lap(SceneStage::Assign);
        if !is_outlier {
            self.learn_photograph(frame, &placed.camera, gain);
        }
        self.poses.recycle(placed);
        self.end_frame();
        clock.lap_photographs(&mut self.photographs);
    }

    /// Replaces the rule by which splats are computed from points.
    pub fn set_splat_rule(&mut self, rule: SplatRule) {
        self.scene.config.splat_rule = rule;
        // It was computed from pictures drawn with the previous rule.
        self.photographs.settled = None;
    }

    fn warnings(&self) -> Vec<TrainingWarning> {
        let UnassignedPoints { budget, reach } = self.unassigned;
        let budget = (budget > 0).then_some(TrainingWarning::OverBudget { points: budget });
        let Scene { coarsened, asked_scale: requested, config, .. } = &self.scene;
        let coarsened = (*coarsened > 0)
            .then(|| TrainingWarning::Coarsened { requested: *requested, scale: round(config.h) });
        let reach = (reach > 0).then_some(TrainingWarning::TooFarFromOrigin { points: reach });
        let splats = self.photographs.learner.repaired;
        let repaired = (splats > 0).then_some(TrainingWarning::PrecisionReset { splats });
        budget.into_iter().chain(coarsened).chain(reach).chain(repaired).collect()
    }

    /// Returns the splat of a component: the photometric estimate if there is one, else the splat of its
    /// points.
    pub(super) fn splat(&self, id: usize) -> (Splat, Appearance) {
        let (splat, appearance) =
            self.photographs.drawn().splat(id).unwrap_or_else(|| self.scene.splat(id));
        (splat, Appearance { observed: self.scene.sums.observed_cone(id), ..appearance })
    }
}

/// Rounds to four significant digits.
fn round(value: f64) -> f64 {
    // Through text, which rounds in decimal.
    format!("{value:.3e}").parse().unwrap_or(value)
}
