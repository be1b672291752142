//! Trains frame by frame, and updates the snapshot.

use super::following::is_read_from;
use super::thread::WorkerThread;
use crate::app::state::{NoticeKind, NoticeOffer, NoticeTopic, OpenAs, RunState, Subject};
use crate::dataset::pose_check::ENOUGH_FRAMES;
use crate::eval::report::Summary;
use crate::pipeline::error::SessionError;
use crate::pipeline::session::Step;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Maximum time spent waiting for an unread frame; then orders are handled.
const PATIENCE: Duration = Duration::from_millis(50);

/// Number of unreadable frames in a row after which training pauses.
const UNREAD_IN_A_ROW: usize = 5;

impl WorkerThread {
    /// Trains on one frame. If the frame has not been read yet, the step remains pending.
    pub(super) fn step_once(&mut self) {
        self.has_pending_step = !self.step();
        if !self.has_pending_step {
            self.outbox.mark_visibility(&self.run);
        }
    }

    /// Trains on the next frame. Returns false if the frame has not been read yet.
    pub(super) fn step(&mut self) -> bool {
        let Some(session) = self.run.session_mut() else { return true };
        let started = Instant::now();
        let was_settled = session.is_settled();
        let step = session.step_within(PATIENCE).transpose();
        self.outbox.set_unread(step.is_none());
        let Some(step) = step else { return false };
        // The component ELBO of the frame before no longer holds, whether or not this frame changes its
        // components.
        self.outbox.mark(session.learner().last_frame().component_elbo.components());
        match step {
            Ok(Step::Waiting) => {}
            Ok(Step::Trained(_)) => {
                self.outbox.mark_trained(session.learner());
                self.n_unread = 0;
                self.outbox.snapshot.pace.trained_s += started.elapsed().as_secs_f64();
                self.outbox.add_late_reports(&self.run);
                self.record_trained_frame();
            }
            Ok(step @ (Step::Skipped(_) | Step::Lost(_))) => {
                if was_settled && !session.is_settled() {
                    // After a frame that could not be placed, pending photographs are no longer part of
                    // the drawn scene.
                    self.outbox.mark_all(&self.run);
                }
                self.note_skipped_frame(&step);
                self.refresh_session_info();
            }
            Ok(Step::Finished) => self.finish(),
            // Nothing was trained that could be exported.
            Err(error @ SessionError::NoUsableFrame { .. }) => self.fail(error.to_string()),
            Err(error) => self.fail(format!("{error}; the scene trained so far can be exported")),
        }
        self.add_outlier_reports();
        self.following.update(&self.run, &mut self.outbox);
        true
    }

    /// Pauses training after [`UNREAD_IN_A_ROW`] unreadable frames in a row, since the drive may be gone.
    fn note_skipped_frame(&mut self, step: &Step) {
        let skipped = match step {
            Step::Skipped(skipped) => {
                self.n_unread += 1;
                skipped
            }
            Step::Lost(skipped) => skipped,
            Step::Trained(_) | Step::Waiting | Step::Finished => return,
        };
        // No notice for a single one, because a dataset may lack many frames. The status line counts them,
        // the summary lists them.
        tracing::warn!("{}", skipped.message);
        // A recording that is still written gets its frames back later.
        let is_live = self.outbox.snapshot.following.recording.is_some();
        if self.n_unread < UNREAD_IN_A_ROW || is_live {
            return;
        }
        self.n_unread = 0;
        if self.outbox.snapshot.state == RunState::Training {
            self.set_state(RunState::Paused);
            let text = format!(
                "training is paused: {UNREAD_IN_A_ROW} frames in a row could not be read; check the drive, then Train goes on ({})",
                skipped.message
            );
            self.outbox.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
        }
    }

    fn add_outlier_reports(&mut self) {
        let Some(session) = self.run.session_mut() else { return };
        let reports = session.take_outlier_warnings();
        if !reports.is_empty() {
            // A new list, because published snapshots share the old one.
            let known = &self.outbox.snapshot.frames.outliers;
            self.outbox.snapshot.frames.outliers = Arc::new([&known[..], &reports].concat());
        }
    }

    fn record_trained_frame(&mut self) {
        self.files.record_frame();
        let snapshot = &mut self.outbox.snapshot;
        snapshot.frames_done += 1;
        snapshot.files.unsaved_frames += 1;
        // The first sample was taken when the recording had too few frames.
        if snapshot.following.recording.is_some() && snapshot.frames_done == ENOUGH_FRAMES {
            self.run.start_sampling();
        }
        self.outbox.record_frame();
        self.refresh_session_info();
    }

    fn finish(&mut self) {
        self.outbox.set_state(RunState::Finished);
        self.outbox.reset_frame_rate();
        self.outbox.mark_visibility(&self.run);
        self.outbox.add_late_reports(&self.run);
        let Some(session) = self.run.session() else { return };
        let summary = Summary::of_frames(session.frames(), 0.0);
        // The performance tests parse this line (`tests/app/window.rs`).
        let (median, all) = (summary.train_ms_median, self.outbox.snapshot.pace.trained_s);
        tracing::info!("finished: train_ms_median {median:.3} trained_s {all:.3}");
        for warning in session.learner().status().warnings {
            let text = warning.to_string();
            self.outbox.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
        }
    }

    /// Updates the drawn scene as if all buffered photographs had been trained on, as in saved files.
    pub(super) fn settle(&mut self) {
        if self.run.session_mut().is_some_and(|session| session.settle()) {
            self.outbox.mark_all(&self.run);
            self.outbox.add_late_reports(&self.run);
            self.add_outlier_reports();
        }
    }

    pub(super) fn refresh_session_info(&mut self) {
        let Some(session) = self.run.session() else { return };
        let (learner, snapshot) = (session.learner(), &mut self.outbox.snapshot);
        let (status, memory) = (learner.status(), learner.memory());
        snapshot.n_frames = session.plan().frames.len();
        snapshot.model.components = status.components;
        snapshot.model.used = status.used;
        snapshot.model.bytes = memory.bytes;
        snapshot.model.texture_bytes = memory.texture_bytes;
        // Frames are only added to the list; snapshots share it until then.
        if snapshot.frames.skipped.len() != session.skipped().len() {
            snapshot.frames.skipped = Arc::new(session.skipped().to_vec());
        }
        self.outbox.is_changed = true;
    }

    /// Publishes the result of sampling the frames once it is available.
    pub(super) fn take_sampling(&mut self) {
        let Some(sampling) = self.run.take_sampling() else { return };
        self.outbox.is_changed = true;
        match sampling {
            Ok(mut sampling) => {
                let path = self.outbox.snapshot.opened.as_ref().and_then(|o| o.path.clone());
                for warning in sampling.poses.iter().flat_map(|check| check.warnings()) {
                    let offer = path.as_ref().and_then(|path| OpenAs::advised(path, &warning));
                    let offer = offer.map(NoticeOffer::OpenAs);
                    let topic = NoticeTopic::Subject;
                    self.outbox.notify_with(topic, NoticeKind::Warning, warning, offer);
                }
                // Frames that cannot be checked do not withdraw an earlier check.
                let earlier = self.outbox.snapshot.sampling.poses.take();
                sampling.poses = sampling.poses.or(earlier);
                self.outbox.snapshot.sampling = sampling;
            }
            Err(text) => self.outbox.notify(NoticeKind::Warning, text),
        }
    }

    pub(super) fn set_follows(&mut self, follows: bool) {
        self.outbox.snapshot.following.is_on = follows;
        if !follows {
            return self.following.stop(&mut self.run, &mut self.outbox);
        }
        let (state, subject) = (self.outbox.snapshot.state, self.run.subject.clone());
        let Some(session) = self.run.session_mut() else { return };
        match subject {
            // From the first frame on: the last ones may have been half-written when they were read.
            Some(subject)
                if state == RunState::Ready && is_read_from(session.dataset(), &subject) =>
            {
                self.open_with(self.run.calibration.clone(), subject);
            }
            _ => {
                if session.follow(None) && state == RunState::Finished {
                    self.outbox.set_state(RunState::Training);
                }
                self.following.update(&self.run, &mut self.outbox);
            }
        }
    }

    /// Starts a session on the first frames of the awaited recording, if they exist.
    pub(super) fn poll_awaited_recording(&mut self) {
        let path = self.run.subject.as_ref().and_then(Subject::path);
        let mut training = self.training.for_dataset(path);
        let calibration = self.run.calibration.as_ref();
        training.scene.calibration = calibration.map(|given| given.calibration.clone());
        match self.following.poll(&training, self.outbox.next_serial) {
            Ok(None) => {}
            Ok(Some(begun)) => {
                self.outbox.next_serial += 1;
                self.install_subject(begun);
                // Training starts without an order, because the recording continues.
                self.outbox.set_state(RunState::Training);
            }
            Err(error) => {
                self.following.stop(&mut self.run, &mut self.outbox);
                self.outbox.notify(NoticeKind::Error, error);
            }
        }
        self.following.update(&self.run, &mut self.outbox);
    }
}
