//! Trains frame by frame, and updates the snapshot.

use super::thread::WorkerThread;
use crate::app::opening::Content;
use crate::app::state::{GivenCalibration, NoticeKind, NoticeTopic, RunState, Subject};
use crate::dataset::calibration::Calibration;
use crate::dataset::pose_check::ENOUGH_FRAMES;
use crate::eval::report::Summary;
use crate::pipeline::error::SessionError;
use crate::pipeline::session::Step;
use crate::train::learner::Changed;
use crate::train::setting::Preset;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Number of frames over which the frame rate is averaged.
const RATE_FRAMES: usize = 30;
/// Timeout of waiting for an unread frame, after which orders are handled.
const PATIENCE: Duration = Duration::from_millis(50);

impl WorkerThread {
    /// Trains on the next frame; false if it has not been read yet.
    pub(super) fn step(&mut self) -> bool {
        let Some(Content::Session(session)) = &mut self.content else { return true };
        let started = Instant::now();
        let was_settled = session.is_settled();
        let at_frame = self.shared.step.begin();
        let step = session.step_within(PATIENCE);
        drop(at_frame);
        let Some(step) = step.transpose() else {
            self.shared.unread.wait();
            return false;
        };
        self.shared.unread.end();
        // The component ELBO of the frame before no longer holds, whether or not this frame changes its
        // components.
        self.dirty.mark(session.learner().component_elbo().components());
        self.changed |= !matches!(step, Ok(Step::Waiting));
        match step {
            Ok(Step::Trained(_)) => {
                let learner = session.learner();
                match learner.changed() {
                    Changed::Listed(ids) => self.dirty.mark(ids),
                    Changed::All => self.dirty.mark_all(learner.components()),
                }
                self.snapshot.trained_s += started.elapsed().as_secs_f64();
                self.add_late_reports();
                self.record_trained_frame();
            }
            Ok(Step::Skipped(skipped)) => {
                if was_settled && !session.is_settled() {
                    // After a frame that could not be placed, pending photographs are no longer part of
                    // the drawn scene.
                    self.dirty.mark_all(session.learner().components());
                }
                // No notice, because a dataset may lack many frames. The status line counts them, the
                // scene panel lists them.
                tracing::warn!("{}", skipped.message);
                self.refresh_session_info();
            }
            Ok(Step::Waiting) => {}
            Ok(Step::Finished) => self.finish(),
            // Nothing was trained that could be exported.
            Err(error @ SessionError::NoUsableFrame { .. }) => self.fail(error.to_string()),
            Err(error) => self.fail(format!("{error}; the scene trained so far can be exported")),
        }
        self.add_outlier_reports();
        self.update_recording_state();
        true
    }

    /// Adds new reports of outlier frames to the snapshot.
    fn add_outlier_reports(&mut self) {
        let Some(Content::Session(session)) = &mut self.content else { return };
        let doubts = session.take_outlier_warnings();
        if !doubts.is_empty() {
            // A new list, because published snapshots share the old one.
            self.snapshot.outlier_reports =
                Arc::new([&self.snapshot.outlier_reports[..], &doubts].concat());
        }
    }

    fn record_trained_frame(&mut self) {
        self.snapshot.frames_done += 1;
        if self.snapshot.followed.is_some() && self.snapshot.frames_done == ENOUGH_FRAMES {
            self.start_frame_sampling();
        }
        self.snapshot.unsaved_frames += 1;
        self.files.record_frame();
        if self.ends.len() == RATE_FRAMES {
            self.ends.pop_front();
        }
        self.ends.push_back(Instant::now());
        if let (Some(first), Some(last)) = (self.ends.front(), self.ends.back()) {
            let span_s = (*last - *first).as_secs_f64();
            self.snapshot.frames_per_s =
                if span_s > 0.0 { (self.ends.len() - 1) as f64 / span_s } else { 0.0 };
        }
        self.refresh_session_info();
    }

    fn finish(&mut self) {
        self.snapshot.state = RunState::Finished;
        self.snapshot.frames_per_s = 0.0;
        self.mark_visibility();
        self.add_late_reports();
        if let Some(Content::Session(session)) = &self.content {
            let summary = Summary::of_frames(session.frames(), 0.0);
            // The performance tests parse this line (`tests/app/window.rs`).
            let (median, all) = (summary.train_ms_median, self.snapshot.trained_s);
            tracing::info!("finished: train_ms_median {median:.3} trained_s {all:.3}");
            for warning in session.learner().warnings() {
                let text = warning.to_string();
                self.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
            }
        }
    }

    /// Includes pending photographs in the drawn scene, as files do.
    pub(super) fn settle(&mut self) {
        if let Some(Content::Session(session)) = &mut self.content
            && session.settle()
        {
            self.dirty.mark_all(session.learner().components());
            self.add_late_reports();
            self.add_outlier_reports();
        }
    }

    /// Marks the components that changed because rays of a frame passed through them, without receiving
    /// points. Done when training rests: delivering all of them after every frame would slow it down.
    pub(super) fn mark_visibility(&mut self) {
        if let Some(Content::Session(session)) = &self.content
            && session.learner().changes_unlisted_components()
        {
            self.dirty.mark_all(session.learner().components());
        }
    }

    pub(super) fn refresh_session_info(&mut self) {
        let Some(Content::Session(session)) = &self.content else { return };
        self.snapshot.n_frames = session.plan().frames.len();
        self.snapshot.components = session.learner().components();
        self.snapshot.used = session.learner().used();
        self.snapshot.model_bytes = session.learner().model_bytes();
        // Frames are only added to the list; snapshots share it until then.
        if self.snapshot.skipped.len() != session.skipped().len() {
            self.snapshot.skipped = Arc::new(session.skipped().to_vec());
        }
    }
}

impl WorkerThread {
    pub(super) fn calibrate(&mut self, path: &Path) {
        let read = match self.calibratable() {
            Ok(subject) => {
                let file = path.to_owned();
                let read = self.read_cancellable(Some(path), move || Calibration::read(&file));
                read.and_then(|read| read.map_err(|error| error.to_string().into()))
                    .map(|calibration| (subject, calibration))
            }
            Err(why) => Err(format!("{}: {why}", path.display()).into()),
        };
        match read {
            Ok((subject, calibration)) => {
                let given = GivenCalibration { calibration, file: Some(path.to_owned()) };
                self.open_with(Some(Arc::new(given)), subject);
            }
            Err(refusal) => self.notify(refusal.kind, refusal.text),
        }
    }

    /// Subject to which a calibration applies, or the reason why there is none.
    fn calibratable(&self) -> Result<Subject, &'static str> {
        match &self.subject {
            None => Err("a calibration applies to a dataset: open the dataset first"),
            Some(Subject::Path(open)) if open.is_file() => {
                Err("a calibration applies to a dataset but a file is open: open its dataset first")
            }
            Some(_) if self.training.preset != Preset::Scene => Err(
                "the paper preset does not support a calibration: choose the scene preset in Settings first",
            ),
            Some(subject) => Ok(subject.clone()),
        }
    }
}
