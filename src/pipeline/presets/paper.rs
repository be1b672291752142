//! Paper preset: the published algorithm.

use crate::dataset::calibration::Calibration;
use crate::dataset::error::DatasetError;
use crate::dataset::range::PositionRange;
use crate::dataset::unproject::{CameraConvention, UnprojectSettings, Unprojector};
use crate::dataset::{Dataset, Layout};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::model::paper::state::{ModelState, Totals};
use crate::model::splat::splats::CovarianceForm;
use crate::observation::points::Points;
use crate::pipeline::any_preset::{AnyPreset, ComponentLimit, Mismatch, PlacedLearner};
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::{LearnerOf, TypedPreset};
use crate::pipeline::plan::Plan;
use crate::pipeline::prefetch::frames_at_once;
use crate::pipeline::run::RunConfig;
use crate::train::outcome::MemoryEstimate;
use crate::train::paper::config::{Init, PaperConfig, UpdateWidth};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;

impl AnyPreset for PaperConfig {
    fn seed(&self) -> u64 {
        self.seed
    }

    fn calibration(&self) -> Option<&Calibration> {
        // The published program assumes registered colour and depth.
        None
    }

    fn component_limit(&self) -> ComponentLimit {
        ComponentLimit::Fixed(self.components)
    }

    fn covariance_form(&self) -> CovarianceForm {
        self.conversion.form
    }

    fn world_placement(&self) -> Vec<(&'static str, String)> {
        // The only estimate, the range of positions, is stored with the model and compared there.
        Vec::new()
    }

    fn camera_convention(&self, layout: Layout) -> CameraConvention {
        match layout {
            // Published figures depend on the rays of the published loader, which reads this layout only.
            Layout::Blender => CameraConvention::Paper,
            _ => CameraConvention::Exact,
        }
    }

    fn memory(&self, pixels: usize) -> MemoryEstimate {
        self.memory(pixels, frames_at_once(), rayon::current_num_threads())
    }

    fn fuse(&self, _: Option<&StoredModel>, _: &[&StoredModel]) -> Option<StoredModel> {
        // Mixtures share their components from the start, so their statistics are added instead.
        None
    }

    fn check(&self, model: &StoredModel) -> Result<(), Mismatch> {
        self.mixture(model).map(|_| ())
    }
}

impl TypedPreset for PaperConfig {
    type Preparation = UnprojectSettings;

    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> UnprojectSettings {
        let RunConfig { camera_convention: convention, edge_filter: filter, .. } = *run;
        UnprojectSettings { convention, filter, normalization }
    }

    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
    ) -> Result<LearnerOf<Self>, SessionError> {
        let normalization = range.normalization();
        let draw = initial_draw(dataset, run, self, normalization)?;
        let learner = learner::begin(self, &draw, normalization)?;
        Ok(PlacedLearner { learner, normalization })
    }

    fn restore(&self, model: &StoredModel, frames: u64) -> Result<LearnerOf<Self>, Mismatch> {
        let (state, normalization) = self.mixture(model)?;
        let learner = learner::restore(self, state.clone(), frames, normalization)?;
        Ok(PlacedLearner { learner, normalization })
    }
}

impl PaperConfig {
    fn mixture<'a>(
        &self,
        model: &'a StoredModel,
    ) -> Result<(&'a ModelState, Normalization), Mismatch> {
        let StoredModel::Mixture { normalization, hyper, state } = model else {
            return Err(Mismatch::Form("a mixture".to_owned()));
        };
        // The prior includes the number of components, which determines the engine's memory.
        if self.hyper() != *hyper {
            return Err(Mismatch::Prior);
        }
        let expected = self.operations.update;
        // 128-bit totals hold every sum of an engine with narrower ones, but not the reverse.
        if matches!(state.totals, Totals::Fixed64 { .. }) && expected != UpdateWidth::Fixed64 {
            return Err(Mismatch::Form(format!("totals of the form {expected:?}")));
        }
        Ok((state, *normalization))
    }
}

/// Chooses the initial means, at random or from the first usable frame.
fn initial_draw(
    dataset: &Dataset,
    run: &RunConfig,
    config: &PaperConfig,
    normalization: Normalization,
) -> Result<InitialDraw, DatasetError> {
    if config.init == Init::Random {
        return Ok(InitialDraw::random(config.components, config.seed));
    }
    // Over the frames of all shards, so that all of them start alike and can be merged.
    let plan = Plan::new(dataset, &run.selection.without_shard(), config.seed)?;
    let settings = config.preparation(run, normalization);
    let mut points = Points::new();
    for &index in &plan.frames {
        let loaded = dataset.load(plan.split, index);
        let counts =
            loaded.and_then(|frame| Unprojector::new().unproject(&frame, &settings, &mut points));
        // Unusable frames are skipped, as in training.
        if counts.is_ok() && !points.is_empty() {
            break;
        }
    }
    Ok(InitialDraw::from_points(&points, config.components, config.seed))
}
