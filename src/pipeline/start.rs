//! Start of a session: the only place that distinguishes the presets of a run.

use super::error::SessionError;
use super::frame_loop::{FrameLoop, PresetLoop};
use super::plan::Plan;
use super::prefetch::Prefetch;
use super::preset::{InitialLearner, ObservationOf, TypedPreset};
use super::run::RunConfig;
use super::settings::method::Method;
use crate::dataset::Dataset;
use crate::dataset::range::PositionRange;
use crate::math::normalization::Normalization;
use crate::model::stored::StoredModel;
use std::sync::Arc;

/// Initial state of a learner.
pub(super) enum InitialState<'a> {
    /// Untrained; positions lie in this range.
    Fresh(&'a PositionRange),
    /// Stored model after this number of frames. It must match the run's settings.
    Stored(&'a StoredModel, u64),
}

/// Starts decoding the frames of a plan from position `first`, for a learner of the run's preset. Also
/// returns the transform from world to model coordinates.
pub(super) fn frame_loop(
    dataset: &Arc<Dataset>,
    run: &RunConfig,
    plan: &Plan,
    first: usize,
    origin: &InitialState,
) -> Result<(Box<dyn FrameLoop>, Normalization), SessionError> {
    match &run.method {
        Method::Paper(config) => preset_loop(config, dataset, run, plan, first, origin),
        Method::Scene(scene) => preset_loop(&**scene, dataset, run, plan, first, origin),
    }
}

fn preset_loop<P: TypedPreset>(
    preset: &P,
    dataset: &Arc<Dataset>,
    run: &RunConfig,
    plan: &Plan,
    first: usize,
    origin: &InitialState,
) -> Result<(Box<dyn FrameLoop>, Normalization), SessionError> {
    let beginning: InitialLearner<ObservationOf<P>> = match origin {
        InitialState::Fresh(range) => preset.begin(dataset, run, range, plan.pixels(dataset))?,
        InitialState::Stored(model, frames) => {
            preset.restore(model, *frames).map_err(SessionError::Stored)?
        }
    };
    let InitialLearner { learner, normalization } = beginning;
    let preparation = preset.preparation(run, normalization);
    let prefetch = Prefetch::start(dataset.clone(), plan, first, preparation)?;
    Ok((Box::new(PresetLoop { prefetch, learner }), normalization))
}
