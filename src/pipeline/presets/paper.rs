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
use crate::pipeline::any_preset::{AnyPreset, ComponentLimit, Mismatch};
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::{InitialLearner, TypedPreset};
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

    /// The published program assumes registered colour and depth.
    fn calibration(&self) -> Option<&Calibration> {
        None
    }

    fn component_limit(&self) -> ComponentLimit {
        ComponentLimit::Fixed(self.components)
    }

    fn covariance_form(&self) -> CovarianceForm {
        self.conversion.form
    }

    /// The range of positions, its only estimate, is stored with the model.
    fn world_placement(&self) -> Vec<(&'static str, String)> {
        Vec::new()
    }

    /// The rays of the published loader belong to the preset, for the layout that it reads.
    fn camera_convention(&self, layout: Layout) -> CameraConvention {
        match layout {
            Layout::Blender => CameraConvention::Paper,
            _ => CameraConvention::Exact,
        }
    }

    fn memory(&self, pixels: usize) -> MemoryEstimate {
        self.memory(pixels, frames_at_once(), rayon::current_num_threads())
    }

    /// Statistics of mixtures are added instead.
    fn fuse(&self, _: Option<&StoredModel>, _: &[&StoredModel]) -> Option<StoredModel> {
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
        _: usize,
    ) -> Result<InitialLearner<Points<f32>>, SessionError> {
        let normalization = range.normalization();
        let draw = initial_draw(dataset, run, self, normalization)?;
        let learner = learner::begin(self, &draw, normalization)?;
        Ok(InitialLearner { learner, normalization })
    }

    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<InitialLearner<Points<f32>>, Mismatch> {
        let (state, normalization) = self.mixture(model)?;
        let learner = learner::restore(self, state.clone(), frames, normalization)
            .map_err(Mismatch::Index)?;
        Ok(InitialLearner { learner, normalization })
    }
}

impl PaperConfig {
    /// Returns the stored mixture if it matches these settings.
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
        if !can_hold(expected, &state.totals) {
            return Err(Mismatch::Form(format!("totals of the form {expected:?}")));
        }
        Ok((state, *normalization))
    }
}

/// True if an engine with this form of totals can continue with the stored ones; 128-bit totals fit any form.
fn can_hold(update: UpdateWidth, totals: &Totals) -> bool {
    match totals {
        Totals::Fixed64 { .. } => update == UpdateWidth::Fixed64,
        Totals::Fixed128(_) => true,
    }
}

/// Computes the initial means. If they come from data, it uses the first usable frame of all shards, so that
/// all shards start alike.
fn initial_draw(
    dataset: &Dataset,
    run: &RunConfig,
    config: &PaperConfig,
    normalization: Normalization,
) -> Result<InitialDraw, DatasetError> {
    if config.init == Init::Random {
        return Ok(InitialDraw::random(config.components, config.seed));
    }
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
