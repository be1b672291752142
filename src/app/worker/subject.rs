//! Opens subjects for training or viewing.

use super::following::{follow_of, is_folder};
use super::shared::{join_opening, start_opening};
use super::thread::{Dirty, WorkerThread};
use crate::app::opening;
use crate::app::opening::{Content, OpenedSubject};
use crate::app::splat_updates::SplatChange;
use crate::app::state::{
    GivenCalibration, NoticeKind, NoticeTopic, RunState, Snapshot, Source, Subject,
};
use crate::eval::report::FrameReport;
use crate::pipeline::follow::Follow;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

enum Found {
    Whole(Box<OpenedSubject>),
    /// A folder that is still being recorded, or will be.
    Recording(Box<Follow>),
}

impl WorkerThread {
    pub(super) fn open_with(
        &mut self,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) {
        if let Err(refusal) = self.try_open(calibration, subject) {
            self.notify(refusal.kind, refusal.text);
        }
    }

    /// Opens the first path that can be opened, because only one subject can be open, and lists the
    /// others in a notice.
    pub(super) fn open_first(&mut self, paths: &[PathBuf]) {
        // One notice for all: a user may drop all photographs of a capture instead of its folder.
        let mut problem = None;
        for (i, path) in paths.iter().enumerate() {
            match self.try_open(None, Subject::Path(path.clone())) {
                // Cancelled, together with the remaining paths.
                Err(refusal) if refusal.kind == NoticeKind::Info => {
                    return self.notify(refusal.kind, refusal.text);
                }
                Err(refusal) => problem = problem.or(Some(refusal.text)),
                Ok(()) if paths.len() == 1 => return,
                Ok(()) => {
                    let others = paths.iter().enumerate().filter(|(j, _)| *j != i);
                    let others: Vec<&PathBuf> = others.map(|(_, path)| path).collect();
                    let reason = problem.map(|p| format!(" ({p})")).unwrap_or_default();
                    let text = format!(
                        "{} is open; only one subject can be open, left out: {}{reason}",
                        path.display(),
                        list_paths(&others)
                    );
                    return self.notify(NoticeKind::Warning, text);
                }
            }
        }
        if let Some(problem) = problem {
            let text = match paths.len() {
                1 => problem,
                n => format!("none of the {n} paths can be opened; the first: {problem}"),
            };
            self.notify(NoticeKind::Error, text);
        }
    }

    fn try_open(
        &mut self,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) -> Result<(), Refusal> {
        let before = self.snapshot.state;
        self.snapshot.state = RunState::Loading;
        // Published at once, because this thread publishes nothing during the opening.
        self.publish(true);
        match self.find(calibration.as_ref(), &subject) {
            Ok(Found::Recording(follow)) => {
                self.await_recording(*follow, calibration, subject);
                Ok(())
            }
            Ok(Found::Whole(opened)) => {
                self.next_serial += 1;
                (self.subject, self.calibration) = (Some(subject), calibration);
                self.install_subject(*opened);
                let dataset = self.snapshot.opened.as_ref().and_then(|o| o.dataset.clone());
                if let Some(path) = dataset.as_ref().and_then(|dataset| dataset.path.as_deref()) {
                    self.offer_abandoned_run(Some(path));
                }
                if self.snapshot.follows {
                    self.set_follows(true);
                }
                Ok(())
            }
            Err(refusal) => {
                self.restore_state(before);
                Err(refusal)
            }
        }
    }

    /// Reads a subject, until the user cancels.
    fn find(
        &mut self,
        calibration: Option<&Arc<GivenCalibration>>,
        subject: &Subject,
    ) -> Result<Found, Refusal> {
        let mut training = self.training.clone();
        // Into the copy, because settings outlive the dataset of the calibration.
        training.scene.calibration = calibration.map(|c| c.calibration.clone());
        let (follows, serial, read) = (self.snapshot.follows, self.next_serial, subject.clone());
        let path = match subject {
            Subject::Path(path) => Some(path.as_path()),
            Subject::Demo => None,
        };
        let found = self.read_cancellable(path, move || match &read {
            Subject::Path(path) if follows && is_folder(&read) => {
                follow_of(path).map(|follow| Found::Recording(Box::new(follow)))
            }
            _ => opening::open(&read, &training, serial)
                .map(|opened| Found::Whole(Box::new(opened)))
                .map_err(|error| error.to_string()),
        });
        Ok(found??)
    }

    /// Restores the state after a failed opening: the subject opened before stays open, paused.
    pub(super) fn restore_state(&mut self, before: RunState) {
        self.snapshot.state = match before {
            RunState::Training => RunState::Paused,
            RunState::Loading => RunState::Empty,
            other => other,
        };
    }

    pub(super) fn install_subject(&mut self, opened: opening::OpenedSubject) {
        self.ends.clear();
        self.dirty = Dirty::default();
        self.forget_notices(NoticeTopic::Subject);
        let notices = self.snapshot.notices.clone();
        self.snapshot = Snapshot {
            opened: Some(Arc::new(opened.opened)),
            notices,
            // The window may not have read yet that its file was written.
            latest_write: self.snapshot.latest_write,
            abandoned: self.snapshot.abandoned.take(),
            follows: self.snapshot.follows,
            calibration: self.calibration.clone(),
            ..Snapshot::default()
        };
        (self.awaited, self.waiting_since) = (None, None);
        self.files.discard();
        // The index would refer to another component.
        self.inspecting = None;
        // Also drops pending updates of the previous scene.
        self.shared.updates.push(SplatChange::all(opened.splats).into());
        match &opened.content {
            Content::Session(session) => {
                self.snapshot.source = Source::Dataset;
                self.snapshot.n_frames = session.plan().frames.len();
                self.snapshot.frames_done = session.learner().frames() as usize;
                self.snapshot.state = match session.visited() {
                    0 if self.subject == Some(Subject::Demo) => RunState::Training,
                    0 => RunState::Ready,
                    n if n < self.snapshot.n_frames => RunState::Paused,
                    _ => RunState::Finished,
                };
                let trained = session.frames().iter().map(|frame| frame.ms.stages.train);
                self.snapshot.trained_s = 1e-3 * trained.sum::<f64>();
                let doubted = session.frames().iter().filter_map(FrameReport::outlier_warning);
                self.snapshot.outlier_reports = Arc::new(doubted.collect());
            }
            Content::Model(splats) => {
                self.snapshot.source = Source::Model;
                self.snapshot.state = RunState::Finished;
                self.snapshot.components = splats.len();
                self.snapshot.used = splats.len();
            }
        }
        self.has_pending_step = false;
        self.content = Some(opened.content);
        self.start_frame_sampling();
        // The splats above were sent without attributes; these follow if the viewport needs them.
        self.watch(self.watched);
        for (kind, text) in opened.notices {
            self.notify_of(NoticeTopic::Subject, kind, text);
        }
        self.refresh_session_info();
    }
}

/// Lists the first few paths, and the number of the others.
fn list_paths(paths: &[&PathBuf]) -> String {
    const NAMED: usize = 3;
    let names: Vec<String> =
        paths.iter().take(NAMED).map(|path| path.display().to_string()).collect();
    match paths.len().saturating_sub(NAMED) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names.join(", ")),
    }
}

/// Interval at which cancellation is polled.
const LOOK: Duration = Duration::from_millis(50);
/// Time without a result after which the user is warned.
const SLOW: Duration = Duration::from_secs(4);

/// Reason why a subject was not opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// Severity; a cancellation by the user is no error.
    pub kind: NoticeKind,
    pub text: String,
}

impl From<String> for Refusal {
    fn from(text: String) -> Self {
        Self { kind: NoticeKind::Error, text }
    }
}

impl WorkerThread {
    /// Returns the result of `work` on a path, or a [`Refusal`] if the user cancels.
    pub(super) fn read_cancellable<T: Send + 'static>(
        &mut self,
        path: Option<&Path>,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> Result<T, Refusal> {
        let name = path.map_or_else(|| "the demo".to_owned(), |path| path.display().to_string());
        self.shared.opening.begin();
        let work = start_opening(&name, work)?;
        let mut is_told = false;
        loop {
            if let Some(ended) = work.wait(LOOK) {
                return Ok(join_opening(&name, ended)?);
            }
            if self.shared.opening.is_cancelled() {
                let text = format!("{name}: opening was cancelled");
                return Err(Refusal { kind: NoticeKind::Info, text });
            }
            if !is_told && work.elapsed() > SLOW {
                is_told = true;
                self.warn_of_slow_drive(&name, work.elapsed());
            }
        }
    }

    fn warn_of_slow_drive(&mut self, name: &str, elapsed: Duration) {
        let text = format!(
            "{name}: expected it to be open, found it still being read after {} s; a drive may be slow or disconnected: wait, or press Cancel opening below and check the drive",
            elapsed.as_secs()
        );
        // Of the subject, so that it disappears once that is open.
        self.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
        self.publish(true);
    }
}
