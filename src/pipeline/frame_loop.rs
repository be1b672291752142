//! Inner training loop: takes prepared frames and updates the learner.

use super::any_preset::{AnyPreset, Mismatch, RestoredLearner};
use super::error::SessionError;
use super::prefetch::{NextFrame, PlannedFrame, Prefetch, Prepared, PreparedFrame};
use super::run::RunConfig;
use super::start::Prepare;
use crate::dataset::range::PositionRange;
use crate::dataset::{Dataset, FrameMarks};
use crate::math::measured_pixel::Normalization;
use crate::model::attributes::StoredModel;
use crate::train::candidates::IndexError;
use crate::train::learner::{Learner, Learns};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::scene::track::TrackingLoss;
use std::time::Duration;

/// Prefetch and learner of one preset, with their types erased.
pub(super) trait FrameLoop: Send {
    /// Trains on the next frame, waiting at most `patience` for it to be decoded.
    fn step(&mut self, patience: Duration) -> StepResult;

    /// Appends frames to the queue.
    fn append(&mut self, frames: &mut dyn Iterator<Item = PlannedFrame>);

    fn learner(&self) -> &dyn Learner;

    fn learner_mut(&mut self) -> &mut dyn Learner;
}

/// Result of a step.
pub(super) enum StepResult {
    Frame(SteppedFrame),
    /// The next frame is not decoded yet.
    Unread,
    Finished,
}

pub(super) struct SteppedFrame {
    /// Position in the plan.
    pub position: usize,
    pub name: String,
    /// Marks of its files before they were read.
    pub marks: FrameMarks,
    /// What happened to the frame.
    pub status: FrameStatus,
}

/// What happened to a frame.
pub(super) enum FrameStatus {
    /// The learner was updated.
    Learnt {
        outcome: Box<FrameOutcome>,
        /// Measured pixels without a point.
        dropped: usize,
        load_ms: f64,
        prepare_ms: f64,
    },
    /// The frame is unusable, for this reason.
    Skipped(String),
    /// Tracking could not estimate its pose.
    Lost(TrackingLoss),
    /// The learner cannot continue.
    Failed(IndexError),
}

/// Prefetch and the learner of its observations.
pub(super) struct PresetLoop<P: Prepare> {
    pub prefetch: Prefetch<P>,
    pub learner: Box<dyn Learns<P::Observation>>,
}

impl<P: Prepare> FrameLoop for PresetLoop<P> {
    fn step(&mut self, patience: Duration) -> StepResult {
        let Prepared { position, is_repeat, name, marks, result } =
            match self.prefetch.next_within(patience) {
                NextFrame::Ready(frame) => frame,
                NextFrame::Unread => return StepResult::Unread,
                NextFrame::None => return StepResult::Finished,
            };
        let status = match result {
            Err(message) => FrameStatus::Skipped(message),
            Ok(PreparedFrame { observation, dropped, load_ms, prepare_ms }) => {
                let learnt = match is_repeat {
                    false => self.learner.learn(&observation),
                    true => Ok(self.learner.revisit_photograph(&observation)),
                };
                self.prefetch.recycle(observation);
                match learnt {
                    Ok(FrameOutcome { tracking: Some(FrameTracking::Lost(loss)), .. }) => {
                        FrameStatus::Lost(loss)
                    }
                    Ok(outcome) => {
                        let outcome = Box::new(outcome);
                        FrameStatus::Learnt { outcome, dropped, load_ms, prepare_ms }
                    }
                    Err(error) => FrameStatus::Failed(error),
                }
            }
        };
        StepResult::Frame(SteppedFrame { position, name, marks, status })
    }

    fn append(&mut self, frames: &mut dyn Iterator<Item = PlannedFrame>) {
        self.prefetch.append(frames);
    }

    fn learner(&self) -> &dyn Learner {
        &*self.learner
    }

    fn learner_mut(&mut self) -> &mut dyn Learner {
        &mut *self.learner
    }
}

/// Observation type of a preset's learner.
pub type ObservationOf<P> = <<P as TypedPreset>::Preparation as Prepare>::Observation;

/// Settings of a preset, with its types.
pub trait TypedPreset: AnyPreset {
    /// Preparation of frames for the learner.
    type Preparation: Prepare;

    /// Returns the preparation for a run whose model uses the coordinates of `normalization`.
    fn preparation(&self, run: &RunConfig, normalization: Normalization) -> Self::Preparation;

    /// Creates an untrained learner for a dataset whose positions lie in `range` and whose frames have at
    /// most `pixels` pixels.
    ///
    /// # Errors
    /// [`SessionError`] if memory does not suffice or the data give no initialisation.
    fn begin(
        &self,
        dataset: &Dataset,
        run: &RunConfig,
        range: &PositionRange,
        pixels: usize,
    ) -> Result<InitialLearner<ObservationOf<Self>>, SessionError>;

    /// Restores a learner after `frames` frames from a stored model.
    ///
    /// # Errors
    /// [`Mismatch`] if the stored model does not match these settings.
    fn restore(
        &self,
        model: &StoredModel,
        frames: u64,
    ) -> Result<InitialLearner<ObservationOf<Self>>, Mismatch>;
}

/// Learner at the start of a session.
pub struct InitialLearner<O> {
    /// The learner.
    pub learner: Box<dyn Learns<O>>,
    /// World to model coordinates.
    pub normalization: Normalization,
}

/// Calls [`TypedPreset::restore`] and erases the observation type.
///
/// # Errors
/// As [`TypedPreset::restore`].
pub(super) fn revive<P: TypedPreset>(
    preset: &P,
    model: &StoredModel,
    frames: u64,
) -> Result<RestoredLearner, Mismatch>
where
    ObservationOf<P>: 'static,
{
    let InitialLearner { learner, normalization } = preset.restore(model, frames)?;
    Ok(RestoredLearner { learner, normalization })
}
