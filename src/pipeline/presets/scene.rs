//! Scene preset.

use crate::dataset::calibration::Calibration;
use crate::dataset::range::PositionRange;
use crate::dataset::surface::SurfaceSettings;
use crate::dataset::unproject::CameraConvention;
use crate::dataset::{Dataset, Layout};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::scene::state::{SceneState, StoredSums};
use crate::model::splat::splats::CovarianceForm;
use crate::observation::surface::Observation;
use crate::pipeline::any_preset::{
    AnyPreset, ComponentLimit, Mismatch, OrderDependence, RestoredLearner,
};
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::{InitialLearner, TypedPreset, revive};
use crate::pipeline::prefetch::frames_at_once;
use crate::pipeline::run::RunConfig;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::outcome::MemoryEstimate;
use crate::train::scene::config::{SceneConfig, SumForm, VisibilityRule};
use crate::train::scene::engine;
use crate::train::scene::photometric::rule::PhotometricMode;

impl AnyPreset for SceneRun {
    fn seed(&self) -> u64 {
        self.seed
    }

    fn calibration(&self) -> Option<&Calibration> {
        self.surface.calibration.as_ref()
    }

    fn component_limit(&self) -> ComponentLimit {
        match self.budget {
            Some(budget) => ComponentLimit::Asked(budget.components()),
            None => ComponentLimit::Default(self.engine.max_components),
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

    fn order_dependence(&self, components: usize) -> Option<OrderDependence> {
        let (found, advice) = order_dependence_of(&self.engine, components)?;
        Some(OrderDependence { found, advice })
    }

    fn is_fused(&self) -> bool {
        !self.engine.births.is_order_invariant()
    }

    fn fuse(&self, origin: Option<&StoredModel>, models: &[&StoredModel]) -> Option<StoredModel> {
        if !self.is_fused() {
            return None;
        }
        let origin = origin.map(|model| self.scene(model)).transpose().ok()?;
        let scenes: Result<Vec<_>, _> = models.iter().map(|model| self.scene(model)).collect();
        engine::fuse(&self.engine, origin, &scenes.ok()?).map(StoredModel::Scene)
    }

    fn check(&self, model: &StoredModel) -> Result<(), Mismatch> {
        self.scene(model).map(|_| ())
    }

    fn restore_any(&self, model: &StoredModel, frames: u64) -> Result<RestoredLearner, Mismatch> {
        revive(self, model, frames)
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
        _: usize,
    ) -> Result<InitialLearner<Observation>, SessionError> {
        let learner = engine::begin(&self.engine, self.surface.origin);
        Ok(InitialLearner { learner, normalization: self.normalization() })
    }

    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<InitialLearner<Observation>, Mismatch> {
        let state = self.scene(model)?.clone();
        let learner = engine::restore(&self.engine, state, frames).ok_or_else(|| {
            Mismatch::Form(
                "seeds that its scale can separate at this distance from the origin".to_owned(),
            )
        })?;
        Ok(InitialLearner { learner, normalization: self.normalization() })
    }
}

impl SceneRun {
    /// Returns the stored scene if it matches these settings.
    fn scene<'a>(&self, model: &'a StoredModel) -> Result<&'a SceneState, Mismatch> {
        let StoredModel::Scene(state) = model else {
            return Err(Mismatch::Form("a scene".to_owned()));
        };
        self.engine.clone().check().map_err(|error| Mismatch::Setting(error.to_string()))?;
        let origin = self.surface.origin.to_array();
        if state.origin != origin {
            return Err(Mismatch::Form(format!("the origin {origin:?}")));
        }
        if !holds_sums(self.engine.sums, &state.sums) {
            return Err(Mismatch::Form(format!("sums of the form {:?}", self.engine.sums)));
        }
        Ok(state)
    }
}

fn holds_sums(form: SumForm, sums: &StoredSums) -> bool {
    form == match sums {
        StoredSums::Mixed { .. } => SumForm::Mixed,
        StoredSums::F32(_) => SumForm::F32,
        StoredSums::F64(_) => SumForm::F64,
    }
}

/// The setting by which a scene depends on the order of frames, and the one to use instead.
fn order_dependence_of(config: &SceneConfig, components: usize) -> Option<(String, &'static str)> {
    let SceneConfig {
        births,
        refine,
        align,
        gain,
        visibility,
        sums,
        max_components,
        photometric,
        track,
        ..
    } = config;
    if *track {
        Some(("--poses track".to_owned(), "--poses recorded"))
    } else if !births.is_order_invariant() {
        Some(("births=seeds".to_owned(), "births=lattice"))
    } else if photometric.is_some() {
        let mode = PhotometricMode::of(*photometric);
        Some((format!("--photometric {mode}"), "--photometric off"))
    } else if *refine {
        Some(("refine=true".to_owned(), "refine=false"))
    } else if *align {
        Some(("align=true".to_owned(), "align=false"))
    } else if *gain {
        Some(("gain=true".to_owned(), "gain=false"))
    } else if *visibility == VisibilityRule::Projected {
        Some(("visibility=projected".to_owned(), "visibility=returned"))
    } else if *sums != SumForm::Mixed {
        Some((format!("sums of the form {sums:?}"), "sums=mixed"))
    } else if components >= config.most_seeds() {
        // The order determines which components were created before the budget was reached.
        Some((
            format!("a budget of {max_components} components that was reached"),
            "a larger --budget",
        ))
    } else {
        None
    }
}
