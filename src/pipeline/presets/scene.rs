//! Scene preset.

use crate::dataset::calibration::Calibration;
use crate::dataset::range::PositionRange;
use crate::dataset::surface::SurfaceSettings;
use crate::dataset::unproject::CameraConvention;
use crate::dataset::{Dataset, Layout};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::scene::state::SceneState;
use crate::model::splat::splats::CovarianceForm;
use crate::pipeline::any_preset::{AnyPreset, ComponentLimit, Mismatch, PlacedLearner};
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::{LearnerOf, TypedPreset};
use crate::pipeline::prefetch::frames_at_once;
use crate::pipeline::run::RunConfig;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::outcome::MemoryEstimate;
use crate::train::scene::config::DEFAULT_MAX_COMPONENTS;
use crate::train::scene::fusion::{fuse, settled};
use crate::train::scene::trainer::SceneTrainer;

impl AnyPreset for SceneRun {
    fn seed(&self) -> u64 {
        self.seed
    }

    fn calibration(&self) -> Option<&Calibration> {
        self.surface.calibration.as_ref()
    }

    fn component_limit(&self) -> ComponentLimit {
        match (self.budget, self.engine.max_components) {
            (Some(budget), _) => ComponentLimit::Asked(budget.components()),
            (None, n) if n < DEFAULT_MAX_COMPONENTS => ComponentLimit::Lowered(n),
            (None, n) => ComponentLimit::Default(n),
        }
    }

    fn lower_default_limit(&mut self, most: usize) {
        if self.budget.is_none() {
            self.engine.max_components = most.min(DEFAULT_MAX_COMPONENTS);
        }
    }

    fn covariance_form(&self) -> CovarianceForm {
        CovarianceForm::Eigen
    }

    fn world_placement(&self) -> Vec<(&'static str, String)> {
        vec![
            ("structural scale", self.engine.h.to_string()),
            ("origin", self.surface.origin.to_string()),
        ]
    }

    fn camera_convention(&self, _: Layout) -> CameraConvention {
        CameraConvention::Exact
    }

    fn memory(&self, pixels: usize) -> MemoryEstimate {
        self.engine.memory(pixels, frames_at_once())
    }

    fn fuse(&self, origin: Option<&StoredModel>, models: &[&StoredModel]) -> Option<StoredModel> {
        let origin = origin.map(|model| self.scene(model)).transpose().ok()?;
        let scenes: Result<Vec<_>, _> = models.iter().map(|model| self.scene(model)).collect();
        fuse(&self.engine, origin, &scenes.ok()?).map(StoredModel::Scene)
    }

    fn settled(&self, model: &StoredModel) -> Option<StoredModel> {
        settled(&self.engine, self.scene(model).ok()?).map(StoredModel::Scene)
    }

    fn check(&self, model: &StoredModel) -> Result<(), Mismatch> {
        self.scene(model).map(|_| ())
    }
}

impl TypedPreset for SceneRun {
    type Preparation = SurfaceSettings;

    fn preparation(&self, _: &RunConfig, _: Normalization) -> SurfaceSettings {
        self.prepared_surface()
    }

    fn begin(
        &self,
        _: &Dataset,
        _: &RunConfig,
        _: &PositionRange,
    ) -> Result<LearnerOf<Self>, SessionError> {
        let learner = Box::new(SceneTrainer::new(&self.engine, self.surface.origin));
        Ok(PlacedLearner { learner, normalization: self.normalization() })
    }

    fn restore(&self, model: &StoredModel, frames: u64) -> Result<LearnerOf<Self>, Mismatch> {
        let state = self.scene(model)?.clone();
        let learner = SceneTrainer::restore(&self.engine, state, frames).ok_or_else(|| {
            Mismatch::Form(
                "seeds that its scale can separate at this distance from the origin".to_owned(),
            )
        })?;
        Ok(PlacedLearner { learner: Box::new(learner), normalization: self.normalization() })
    }
}

impl SceneRun {
    fn scene<'a>(&self, model: &'a StoredModel) -> Result<&'a SceneState, Mismatch> {
        let StoredModel::Scene(state) = model else {
            return Err(Mismatch::Form("a scene".to_owned()));
        };
        // Settings from a file are checked like the user's.
        self.engine.clone().check().map_err(|error| Mismatch::Setting(error.to_string()))?;
        let origin = self.surface.origin.to_array();
        // Compared exactly, since all seeds are relative to it.
        if state.origin != origin {
            return Err(Mismatch::Form(format!("the origin {origin:?}")));
        }
        Ok(state)
    }
}
