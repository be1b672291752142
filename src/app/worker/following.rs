//! Training on a recording while it is written.

use super::awaited::AwaitedRecording;
use super::thread::{Dirty, FrameSampling, WorkerThread};
use crate::app::opening::Content;
use crate::app::session_info::session_info;
use crate::app::splat_updates::SplatChange;
use crate::app::state::{
    Followed, GivenCalibration, NoticeKind, Opened, RunState, Snapshot, Subject,
};
use crate::app::wording;
use crate::dataset::surface::sample::FrameSample;
use crate::dataset::{Dataset, LoadOptions, pose_check};
use crate::export::checkpoint::is_checkpoint;
use crate::pipeline::follow::Follow;
use crate::pipeline::panic_report::PanicReport;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::Session;
use std::any::Any;
use std::path::Path;
use std::sync::Arc;
use std::thread;
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Time without a frame after which training is at rest, and deferred changes are published.
const AT_REST: Duration = Duration::from_millis(500);
/// Interval at which the window receives the cameras of a growing recording, whose list is copied.
const CAMERAS: Duration = Duration::from_secs(2);

impl WorkerThread {
    /// Time until the next poll for frames, if there is none to train.
    pub(super) fn time_to_next_poll(&self) -> Option<Duration> {
        let rest = match (self.snapshot.state, &self.content) {
            (RunState::Waiting, _) => self.awaited.as_ref()?.time_to_next_poll(),
            (RunState::Training, Some(Content::Session(session))) if session.is_caught_up() => {
                session.followed()?.time_to_next_scan()
            }
            _ => return None,
        };
        // At least 1 ms, even if the poll is overdue.
        Some(rest.max(Duration::from_millis(1)))
    }

    pub(super) fn set_follows(&mut self, follows: bool) {
        self.snapshot.follows = follows;
        if !follows {
            return self.stop_following();
        }
        let is_untrained = self.snapshot.state == RunState::Ready;
        match (&mut self.content, self.subject.clone()) {
            // From the first frame on: the last ones may have been half-written when they were read.
            (Some(Content::Session(session)), Some(subject))
                if is_untrained && is_read_from(session.dataset(), &subject) =>
            {
                self.open_with(self.calibration.clone(), subject);
            }
            (Some(Content::Session(session)), _) => {
                if session.follow(None) && self.snapshot.state == RunState::Finished {
                    self.snapshot.state = RunState::Training;
                }
                self.update_recording_state();
            }
            _ => {}
        }
    }

    fn stop_following(&mut self) {
        self.snapshot.followed = None;
        self.awaited = None;
        if self.snapshot.state == RunState::Waiting {
            self.snapshot.state = RunState::Empty;
        }
        if let Some(Content::Session(session)) = &mut self.content {
            session.stop_following();
        }
    }

    /// Waits for a folder to hold a frame, which may take long; nothing else is open meanwhile.
    pub(super) fn await_recording(
        &mut self,
        follow: Follow,
        calibration: Option<Arc<GivenCalibration>>,
        subject: Subject,
    ) {
        self.awaited = Some(AwaitedRecording::new(follow));
        (self.subject, self.calibration) = (Some(subject), calibration);
        (self.content, self.dirty) = (None, Dirty::default());
        self.files.discard();
        self.first_look = None;
        self.shared.updates.push(SplatChange::All(Arc::default()).into());
        self.snapshot = Snapshot {
            state: RunState::Waiting,
            notices: self.snapshot.notices.clone(),
            latest_write: self.snapshot.latest_write,
            abandoned: self.snapshot.abandoned.take(),
            follows: true,
            ..Snapshot::default()
        };
        self.update_recording_state();
    }

    /// Starts a session on the first frames of the awaited recording, if they exist.
    pub(super) fn poll_awaited_recording(&mut self) {
        let Some(mut awaited) = self.awaited.take() else { return };
        let mut training = self.training.clone();
        training.scene.calibration = self.calibration.as_ref().map(|c| c.calibration.clone());
        match awaited.poll(&training, self.next_serial) {
            Ok(None) => self.awaited = Some(awaited),
            Ok(Some(mut begun)) => {
                awaited.hand_over(&mut begun);
                self.next_serial += 1;
                self.install_subject(begun);
                // Training starts without an order, because the recording continues.
                self.snapshot.state = RunState::Training;
                self.changed = true;
            }
            Err(error) => {
                self.stop_following();
                self.notify(NoticeKind::Error, error);
                self.changed = true;
            }
        }
        self.update_recording_state();
    }

    /// Updates the state of the recording in the snapshot.
    pub(super) fn update_recording_state(&mut self) {
        let session = match &self.content {
            Some(Content::Session(session)) => Some(&**session),
            _ => None,
        };
        let is_waiting = session.is_none_or(Session::is_caught_up);
        let of = |follow: &Follow, problem| Followed {
            path: follow.path().to_owned(),
            is_waiting,
            problem,
        };
        let followed = match (&self.awaited, session.and_then(Session::followed)) {
            (Some(awaited), _) => Some(of(awaited.follow(), awaited.problem())),
            (None, followed) => {
                followed.map(|follow| of(follow, follow.problem().map(str::to_owned)))
            }
        };
        let has_ended = followed.is_none() && self.snapshot.followed.is_some();
        self.changed |= self.snapshot.followed != followed;
        self.snapshot.followed = followed;
        if has_ended && self.snapshot.follows {
            self.snapshot.follows = false;
            let n = self.snapshot.n_frames;
            self.notify(
                NoticeKind::Info,
                format!("The recording has ended; it has {n} frames to train"),
            );
        }
        if has_ended || self.cameras_updated.elapsed() > CAMERAS {
            self.update_cameras();
        }
        self.publish_at_rest(is_waiting && self.snapshot.followed.is_some());
    }

    /// Publishes the grown list of frames and cameras.
    fn update_cameras(&mut self) {
        let (Some(Content::Session(session)), Some(opened)) =
            (&self.content, &self.snapshot.opened)
        else {
            return;
        };
        let is_told =
            opened.dataset.as_ref().is_some_and(|told| Arc::ptr_eq(told, session.dataset()));
        if !is_told {
            let (dataset, info) = (Some(session.dataset().clone()), session_info(session));
            let plan = Some(Arc::new(session.plan().clone()));
            let opened = Opened { dataset, plan, info, ..Opened::clone(opened) };
            self.snapshot.opened = Some(Arc::new(opened));
            self.changed = true;
        }
        self.cameras_updated = Instant::now();
    }

    /// Publishes changes deferred until training rests (see `mark_visibility`), once per rest.
    fn publish_at_rest(&mut self, is_waiting: bool) {
        match self.waiting_since {
            _ if !is_waiting => self.waiting_since = Some(Instant::now()),
            Some(since) if since.elapsed() > AT_REST => {
                self.waiting_since = None;
                self.reset_frame_rate();
                self.mark_visibility();
                self.changed = true;
            }
            Some(_) | None => {}
        }
    }
}

/// Returns the follower of a folder, which selects all its frames.
pub(super) fn follow_of(path: &Path) -> Result<Follow, String> {
    let selection = Selection { follow: true, ..Selection::all_frames() };
    Follow::new(path, &LoadOptions::default(), &selection).map_err(|error| error.to_string())
}

/// True if a dataset was read from the folder of a subject. Uses the state at opening: a query now
/// would block if the drive does not respond.
fn is_read_from(dataset: &Dataset, subject: &Subject) -> bool {
    matches!(subject, Subject::Path(path) if dataset.is_folder && dataset.path.as_ref() == Some(path))
}

/// True if a subject is a folder, existing or not, and no file that is opened as a whole.
pub(super) fn is_folder(subject: &Subject) -> bool {
    matches!(subject, Subject::Path(path) if !path.is_file() && !is_checkpoint(path))
}

impl WorkerThread {
    /// Starts sampling the opened dataset; drops a sampling of the previous one.
    pub(super) fn start_frame_sampling(&mut self) {
        self.first_look = None;
        let Some(Content::Session(session)) = &self.content else { return };
        let (dataset, split) = (session.dataset().clone(), session.plan().split);
        let surface = session.config().method.scene().map(|run| run.surface.clone());
        let frames = session.plan().first_pass();
        let look = move || FrameSampling {
            sample: surface
                .and_then(|surface| FrameSample::of(&dataset, split, &frames, &surface).ok()),
            // The poses of the built-in scene are exact.
            poses: dataset.path.as_ref().and_then(|_| pose_check::check(&dataset, split)),
        };
        match thread::Builder::new().name("first look".into()).spawn(look) {
            Ok(thread) => self.first_look = Some(thread),
            Err(error) => tracing::warn!("starting the thread that samples frames failed: {error}"),
        }
    }

    /// Publishes the result, once.
    pub(super) fn take_frame_sampling(&mut self) {
        let Some(thread) = self.first_look.take_if(|thread| thread.is_finished()) else { return };
        self.changed = true;
        let look = match join_sampling(thread) {
            Ok(look) => look,
            Err(text) => return self.notify(NoticeKind::Warning, text),
        };
        self.snapshot.sample = look.sample;
        let Some(check) = look.poses else { return };
        if let Some(warning) = wording::pose_warning(&check) {
            self.notify(NoticeKind::Warning, warning);
        }
        self.snapshot.poses = Some(Arc::new(check));
    }
}

/// Result of the thread, or the notice about its panic.
fn join_sampling(thread: JoinHandle<FrameSampling>) -> Result<FrameSampling, String> {
    let told = |panic: Box<dyn Any + Send>| {
        PanicReport::of(&*panic).failure_notice("checking the frames for doubtful poses")
    };
    thread.join().map_err(told)
}

#[cfg(test)]
mod first_look_tests {
    use super::*;

    #[test]
    fn a_look_that_panics_is_told() {
        let told = join_sampling(thread::spawn(|| panic!("injected into sampling"))).err().unwrap();
        for part in ["injected into sampling", "doubtful poses", "report it"] {
            assert!(told.contains(part), "{part:?} is missing in: {told}");
        }
    }
}
