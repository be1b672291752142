//! Inner training loop: takes prepared frames and updates the learner. Also selects the concrete types of
//! the run's preset.

use super::any_preset::{AnyPreset, Mismatch, PlacedLearner};
use super::error::SessionError;
use super::plan::Plan;
use super::prefetch::{
    FrameWatcher, Next, PlannedFrame, Prefetch, Prepare, Prepared, PreparedFrame,
};
use super::run::RunConfig;
use super::settings::method::Method;
use crate::dataset::range::PositionRange;
use crate::dataset::{Dataset, FrameMarks};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::train::candidates::IndexError;
use crate::train::learner::{Learner, Learns};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::scene::track::TrackingLoss;
use std::sync::Arc;
use std::time::Duration;

/// Type-erased prefetch and learner of one preset.
pub(super) trait FrameLoop: Send {
    /// Trains on the next frame. Waits at most `patience` until it is decoded.
    fn step(&mut self, patience: Duration) -> Next<SteppedFrame>;

    fn append(&mut self, frames: &mut dyn Iterator<Item = PlannedFrame>);

    fn watch(&self, watcher: FrameWatcher);

    fn learner(&self) -> &dyn Learner;

    fn learner_mut(&mut self) -> &mut dyn Learner;
}

pub(super) struct SteppedFrame {
    /// Position in the plan.
    pub position: usize,
    pub name: String,
    /// Modification times and sizes of the frame's files before they were read.
    pub marks: FrameMarks,
    pub status: FrameStatus,
}

pub(super) enum FrameStatus {
    Learned {
        outcome: Box<FrameOutcome>,
        /// Number of pixels with measured depth that gave no point.
        dropped: usize,
        load_ms: f64,
        prepare_ms: f64,
    },
    /// Reason why the frame is unusable.
    Skipped(String),
    /// Tracking did not find the pose of the frame.
    Lost(TrackingLoss),
    Failed(IndexError),
}

pub(super) struct PresetLoop<P: Prepare> {
    pub prefetch: Prefetch<P>,
    pub learner: Box<dyn Learns<P::Observation>>,
}

impl<P: Prepare> FrameLoop for PresetLoop<P> {
    fn step(&mut self, patience: Duration) -> Next<SteppedFrame> {
        let Prepared { position, is_repeat, name, marks, result } =
            match self.prefetch.next_within(patience) {
                Next::Ready(frame) => frame,
                Next::Unread => return Next::Unread,
                Next::End => return Next::End,
            };
        let status = match result {
            Err(message) => FrameStatus::Skipped(message),
            Ok(PreparedFrame { observation, dropped, load_ms, prepare_ms }) => {
                // Points count once: further passes train on the photograph only.
                let learned = match is_repeat {
                    false => self.learner.learn(&observation),
                    true => Ok(self.learner.revisit_photograph(&observation)),
                };
                // Recycled before the result is examined, so that a failed frame returns its memory as
                // well.
                self.prefetch.recycle(observation);
                match learned {
                    Ok(FrameOutcome { tracking: Some(FrameTracking::Lost(loss)), .. }) => {
                        FrameStatus::Lost(loss)
                    }
                    Ok(outcome) => {
                        // Boxed, because the other variants are much smaller.
                        let outcome = Box::new(outcome);
                        FrameStatus::Learned { outcome, dropped, load_ms, prepare_ms }
                    }
                    Err(error) => FrameStatus::Failed(error),
                }
            }
        };
        Next::Ready(SteppedFrame { position, name, marks, status })
    }

    fn append(&mut self, frames: &mut dyn Iterator<Item = PlannedFrame>) {
        self.prefetch.append(frames);
    }

    fn watch(&self, watcher: FrameWatcher) {
        self.prefetch.watch(watcher);
    }

    fn learner(&self) -> &dyn Learner {
        &*self.learner
    }

    fn learner_mut(&mut self) -> &mut dyn Learner {
        &mut *self.learner
    }
}

pub(super) enum InitialState<'a> {
    /// There is no trained model yet; the positions of the dataset are in this range.
    Fresh(&'a PositionRange),
    /// Stored model that matches the run's settings, and its number of trained frames.
    Stored(&'a StoredModel, u64),
}

/// Creates the loop for the run's preset and starts decoding the plan's frames from position `first`.
/// Returns the loop and the transformation from world to model coordinates.
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
    let PlacedLearner { learner, normalization } = match origin {
        InitialState::Fresh(range) => preset.begin(dataset, run, range)?,
        InitialState::Stored(model, frames) => {
            preset.restore(model, *frames).map_err(SessionError::Stored)?
        }
    };
    let preparation = preset.preparation(run, normalization);
    let prefetch = Prefetch::start(dataset.clone(), plan, first, preparation)?;
    Ok((Box::new(PresetLoop { prefetch, learner }), normalization))
}

/// Learner for preset `P`, which accepts the observations that the preset's frame preparation produces.
pub type LearnerOf<P> =
    PlacedLearner<dyn Learns<<<P as TypedPreset>::Preparation as Prepare>::Observation>>;

/// Settings of a preset, with the concrete types of its frame preparation and observations.
pub trait TypedPreset: AnyPreset {
    /// Type that prepares frames for the learner.
    type Preparation: Prepare;

    /// Returns the frame preparation for a model whose coordinates are defined by `normalization`.
    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> Self::Preparation;

    /// Creates an untrained learner for a dataset with positions in `range`.
    ///
    /// # Errors
    /// [`SessionError`] if memory does not suffice or the model cannot be initialised from the data.
    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
    ) -> Result<LearnerOf<Self>, SessionError>;

    /// Restores a learner from a stored model that was trained on `frames` frames.
    ///
    /// # Errors
    /// [`Mismatch`] if the stored model does not match these settings.
    fn restore(&self, model: &StoredModel, frames: u64) -> Result<LearnerOf<Self>, Mismatch>;
}

/// Restores a learner of either preset, type-erased (see [`TypedPreset::restore`]).
pub(super) fn restore_any(
    method: &Method,
    model: &StoredModel,
    frames: u64,
) -> Result<PlacedLearner, Mismatch> {
    fn erase<O: 'static>(placed: PlacedLearner<dyn Learns<O>>) -> PlacedLearner {
        PlacedLearner { learner: placed.learner, normalization: placed.normalization }
    }
    match method {
        Method::Paper(config) => config.restore(model, frames).map(erase),
        Method::Scene(scene) => scene.restore(model, frames).map(erase),
    }
}
