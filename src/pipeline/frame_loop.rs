//! The heart of the training loop: prepared frames in, a learner that has learnt them out.

use super::prefetch::{NextFrame, PlannedFrame, Prefetch, Prepared, PreparedFrame};
use super::prepare::Prepare;
use crate::dataset::FrameMarks;
use crate::train::candidates::IndexError;
use crate::train::learner::{Learner, Learns};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::scene::track::TrackingLoss;
use std::time::Duration;

/// Frames and the learner they are for, whichever preset ties them together.
pub(super) trait FrameLoop: Send {
    /// Learns from the next frame, waiting no longer than that for it to be decoded.
    fn step(&mut self, patience: Duration) -> Stepped;

    /// Frames that come behind all others.
    fn append(&mut self, frames: &mut dyn Iterator<Item = PlannedFrame>);

    /// The learner.
    fn learner(&self) -> &dyn Learner;

    /// The learner, to ask it for more.
    fn learner_mut(&mut self) -> &mut dyn Learner;
}

/// What a step came to.
pub(super) enum Stepped {
    Frame(SteppedFrame),
    /// The next frame is not read yet.
    Unread,
    /// There are no more frames.
    Finished,
}

/// A frame that was gone through.
pub(super) struct SteppedFrame {
    /// Position in the plan.
    pub position: usize,
    /// Name within the split.
    pub name: String,
    /// What its files looked like before they were read.
    pub marks: FrameMarks,
    /// What became of it.
    pub status: FrameStatus,
}

/// What became of a frame.
pub(super) enum FrameStatus {
    /// It was learnt.
    Learnt {
        outcome: Box<FrameOutcome>,
        /// Measured pixels that made no point.
        dropped: usize,
        load_ms: f64,
        prepare_ms: f64,
    },
    /// It cannot be used, and why.
    Skipped(String),
    /// Tracking could not place it, and why.
    Lost(TrackingLoss),
    /// The learner cannot go on.
    Failed(IndexError),
}

/// A preparation and the learner of what it prepares.
pub(super) struct PresetLoop<P: Prepare> {
    pub prefetch: Prefetch<P>,
    pub learner: Box<dyn Learns<P::Observation>>,
}

impl<P: Prepare> FrameLoop for PresetLoop<P> {
    fn step(&mut self, patience: Duration) -> Stepped {
        let Prepared { position, is_repeat, name, marks, result } =
            match self.prefetch.next_within(patience) {
                NextFrame::Ready(frame) => frame,
                NextFrame::Unread => return Stepped::Unread,
                NextFrame::None => return Stepped::Finished,
            };
        let status = match result {
            Err(message) => FrameStatus::Skipped(message),
            Ok(PreparedFrame { observation, dropped, load_ms, prepare_ms }) => {
                let learnt = match is_repeat {
                    false => self.learner.learn(&observation),
                    true => Ok(self.learner.look_again(&observation)),
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
        Stepped::Frame(SteppedFrame { position, name, marks, status })
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
