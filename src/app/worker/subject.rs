//! Opening what is trained or looked at.

use super::dirty::Dirty;
use super::following::{follow_of, is_folder};
use super::reading::Refusal;
use super::thread::WorkerThread;
use crate::app::opening::{self, Content, OpenedSubject};
use crate::app::splat_updates::SplatChange;
use crate::app::state::{
    GivenCalibration, NoticeKind, NoticeTopic, RunState, Snapshot, Source, Subject,
};
use crate::eval::report::FrameReport;
use crate::pipeline::follow::Follow;
use std::path::PathBuf;
use std::sync::Arc;

/// What a subject turned out to be.
enum Found {
    /// Something whole.
    Whole(Box<OpenedSubject>),
    /// A folder that is still being written, or will be.
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

    /// Opens the first that can be opened, since only one thing is open at a time, and says what became
    /// of the others.
    pub(super) fn open_first(&mut self, paths: &[PathBuf]) {
        // One notice for all: somebody may drop all photographs of a capture instead of its folder.
        let mut problem = None;
        for (i, path) in paths.iter().enumerate() {
            match self.try_open(None, Subject::Path(path.clone())) {
                // Given up, and the others with it.
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
                        "{} is open, one thing at a time; left out: {}{reason}",
                        path.display(),
                        named(&others)
                    );
                    return self.notify(NoticeKind::Warning, text);
                }
            }
        }
        if let Some(problem) = problem {
            let text = match paths.len() {
                1 => problem,
                n => format!("none of {n} things can be opened; the first: {problem}"),
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
        // Told at once: while something is opened this thread tells nothing more.
        self.publish(true);
        match self.find(calibration.as_ref(), &subject) {
            Ok(Found::Recording(follow)) => {
                self.await_recording(*follow, calibration, subject);
                Ok(())
            }
            Ok(Found::Whole(opened)) => {
                self.next_serial += 1;
                (self.subject, self.calibration) = (Some(subject), calibration);
                self.begin(*opened);
                let dataset = self.snapshot.opened.as_ref().and_then(|o| o.dataset.clone());
                if let Some(path) = dataset.as_ref().and_then(|dataset| dataset.path.as_deref()) {
                    self.look_for_abandoned(Some(path));
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

    /// Reads a subject, as long as the user waits for it.
    fn find(
        &mut self,
        calibration: Option<&Arc<GivenCalibration>>,
        subject: &Subject,
    ) -> Result<Found, Refusal> {
        let mut training = self.training.clone();
        // Into the copy: settings outlive the dataset that the calibration belongs to.
        training.scene.calibration = calibration.map(|c| c.calibration.clone());
        let (follows, serial, read) = (self.snapshot.follows, self.next_serial, subject.clone());
        let path = match subject {
            Subject::Path(path) => Some(path.as_path()),
            Subject::Demo => None,
        };
        let found = self.read(path, move || match &read {
            Subject::Path(path) if follows && is_folder(&read) => {
                follow_of(path).map(|follow| Found::Recording(Box::new(follow)))
            }
            _ => opening::open(&read, &training, serial)
                .map(|opened| Found::Whole(Box::new(opened)))
                .map_err(|error| error.to_string()),
        });
        Ok(found??)
    }

    /// After something could not be opened: what was open stays open, at rest.
    pub(super) fn restore_state(&mut self, before: RunState) {
        self.snapshot.state = match before {
            RunState::Training => RunState::Paused,
            RunState::Loading => RunState::Empty,
            other => other,
        };
    }

    pub(super) fn begin(&mut self, opened: opening::OpenedSubject) {
        self.ends.clear();
        self.dirty = Dirty::default();
        self.forget_notices(NoticeTopic::Subject);
        let notices = self.snapshot.notices.clone();
        self.snapshot = Snapshot {
            opened: Some(Arc::new(opened.opened)),
            notices,
            // The window may still have to read that its file was written just before.
            latest_write: self.snapshot.latest_write,
            abandoned: self.snapshot.abandoned.take(),
            follows: self.snapshot.follows,
            calibration: self.calibration.clone(),
            ..Snapshot::default()
        };
        (self.frames_since_checkpoint, self.rescued) = (0, None);
        (self.awaited, self.waiting_since) = (None, None);
        self.forget_autosave();
        // The number would name another component.
        self.inspecting = None;
        // Also drops what still waits there, which is of the scene before.
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
                let doubted = session.frames().iter().filter_map(FrameReport::doubt);
                self.snapshot.doubts = Arc::new(doubted.collect());
            }
            Content::Model(splats) => {
                self.snapshot.source = Source::Model;
                self.snapshot.state = RunState::Finished;
                self.snapshot.components = splats.len();
                self.snapshot.used = splats.len();
            }
        }
        self.owes_step = false;
        self.content = Some(opened.content);
        self.look_at_frames();
        // The splats above went without what is known of them; it follows if
        // the viewport asks for it.
        self.watch(self.watched);
        for (kind, text) in opened.notices {
            self.notify_of(NoticeTopic::Subject, kind, text);
        }
        self.refresh_session_info();
    }
}

/// The first few paths and how many more there are.
fn named(paths: &[&PathBuf]) -> String {
    const NAMED: usize = 3;
    let names: Vec<String> =
        paths.iter().take(NAMED).map(|path| path.display().to_string()).collect();
    match paths.len().saturating_sub(NAMED) {
        0 => names.join(", "),
        more => format!("{} and {more} more", names.join(", ")),
    }
}
