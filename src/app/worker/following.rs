//! Trains on a recording while it is being written.
//!
//! A session starts once the first frames exist. The start reads some of the frames, so it runs in a
//! separate job: a drive that does not respond must not block the training thread.

use super::outbox::Outbox;
use super::run::Run;
use super::subject::{join_opening, start_opening};
use crate::app::opening;
use crate::app::opening::{Content, OpenError, OpenedSubject};
use crate::app::state::{Followed, NoticeKind, Opened, RunState, Subject};
use crate::app::training::TrainSettings;
use crate::app::wording::session_info;
use crate::dataset::{Dataset, LoadOptions};
use crate::export::checkpoint::is_checkpoint;
use crate::pipeline::follow::{Follow, silence};
use crate::pipeline::job::Job;
use crate::pipeline::plan::Selection;
use crate::pipeline::session::Session;
use std::path::Path;
use std::sync::Arc;
use std::time::{Duration, Instant};

/// Time without a new frame after which training is considered idle and deferred changes are published.
const AT_REST: Duration = Duration::from_millis(500);
/// Interval at which the window receives the cameras of a growing recording. Each update copies the list
/// of cameras.
const CAMERAS: Duration = Duration::from_secs(2);
/// Maximum time to wait for a session to start before commands from the window are handled.
const PATIENCE: Duration = Duration::from_millis(50);

#[derive(Default)]
pub struct Following {
    /// Awaited recording, for which no session has started.
    awaited: Option<Follow>,
    /// Job that starts a session on the first frames of the recording.
    beginning: Option<Job<Result<OpenedSubject, OpenError>>>,
    /// Time at which training ran out of frames; `None` once training is considered idle.
    waiting_since: Option<Instant>,
    /// Time of the last update of the cameras of a growing recording.
    cameras_updated: Option<Instant>,
}

impl Following {
    /// Starts to await a recording; `None` stops waiting.
    pub fn await_recording(&mut self, follow: Option<Follow>) {
        (self.awaited, self.beginning, self.waiting_since) = (follow, None, None);
    }

    pub fn stop(&mut self, run: &mut Run, out: &mut Outbox) {
        self.await_recording(None);
        out.snapshot.following.recording = None;
        if out.snapshot.state == RunState::Waiting {
            out.set_state(RunState::Empty);
        }
        if let Some(session) = run.session_mut() {
            session.stop_following();
        }
    }

    /// Returns the time until the next poll for frames; `None` unless training waits for a recording.
    pub fn time_to_next_poll(&self, state: RunState, run: &Run) -> Option<Duration> {
        let rest = match (state, run.session()) {
            // `poll` itself waits for the job.
            (RunState::Waiting, _) if self.beginning.is_some() => Duration::ZERO,
            (RunState::Waiting, _) => self.awaited.as_ref()?.time_to_next_scan(),
            (RunState::Training, Some(session)) if session.is_caught_up() => {
                session.followed()?.time_to_next_scan()
            }
            _ => return None,
        };
        // At least 1 ms, even if the poll is overdue.
        Some(rest.max(Duration::from_millis(1)))
    }

    /// Returns the opened recording once its first frames exist and the session has started. The session
    /// trains with the settings in `training`; the recording has the serial number `serial`.
    ///
    /// # Errors
    /// If no session can ever start.
    pub fn poll(
        &mut self,
        training: &TrainSettings,
        serial: u64,
    ) -> Result<Option<OpenedSubject>, String> {
        let Some(follow) = &mut self.awaited else { return Ok(None) };
        let name = follow.path().display().to_string();
        if self.beginning.is_none() {
            let found = follow.poll_dataset().map_err(|error| error.to_string())?;
            let Some(dataset) = found else { return Ok(None) };
            let request = training.request().map_err(|refused| refused.to_string())?;
            let (path, selection) = (follow.path().to_owned(), follow.selection().clone());
            let begins = move || {
                let session = Session::new(dataset, request, selection)?;
                Ok(opening::session(session, serial, Some(&path)))
            };
            self.beginning = Some(start_opening(&name, begins)?);
        }
        let Some(ended) = self.beginning.as_ref().and_then(|job| job.wait(PATIENCE)) else {
            return Ok(None);
        };
        self.beginning = None;
        match join_opening(&name, ended)? {
            Ok(mut begun) => {
                if let Content::Session(session) = &mut begun.content {
                    session.follow(self.awaited.take());
                }
                Ok(Some(begun))
            }
            // The frames so far may be unusable, unlike later ones.
            Err(OpenError::Session(error)) if follow.may_succeed_later(&error) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    pub fn update(&mut self, run: &Run, out: &mut Outbox) {
        let session = run.session();
        let is_waiting = session.is_none_or(Session::is_caught_up);
        let followed = match &self.awaited {
            Some(awaited) => Some((awaited, self.silence())),
            None => session.and_then(Session::followed).map(|follow| (follow, None)),
        };
        let followed = followed.map(|(follow, silence)| Followed {
            path: follow.path().to_owned(),
            is_waiting,
            problem: silence.or_else(|| follow.problem().map(str::to_owned)),
        });
        let has_ended = followed.is_none() && out.snapshot.following.recording.is_some();
        if out.snapshot.following.recording != followed {
            out.snapshot.following.recording = followed;
            out.is_changed = true;
        }
        if has_ended && out.snapshot.following.is_on {
            out.snapshot.following.is_on = false;
            let text = format!(
                "The recording has ended; it has {} frames to train",
                out.snapshot.n_frames
            );
            out.notify(NoticeKind::Info, text);
        }
        if has_ended || self.cameras_updated.is_none_or(|at| at.elapsed() > CAMERAS) {
            self.update_cameras(run, out);
        }
        self.publish_at_rest(is_waiting && out.snapshot.following.recording.is_some(), run, out);
    }

    /// Returns a warning if the drive does not respond while a session starts.
    fn silence(&self) -> Option<String> {
        let (follow, job) = (self.awaited.as_ref()?, self.beginning.as_ref()?);
        silence(follow.path(), job.elapsed())
    }

    fn update_cameras(&mut self, run: &Run, out: &mut Outbox) {
        let (Some(session), Some(opened)) = (run.session(), &out.snapshot.opened) else { return };
        // A growing dataset is copied, because the snapshot shares it.
        let is_published =
            opened.dataset.as_ref().is_some_and(|dataset| Arc::ptr_eq(dataset, session.dataset()));
        if !is_published {
            let (dataset, info) = (Some(session.dataset().clone()), session_info(session));
            let plan = Some(Arc::new(session.plan().clone()));
            let opened = Opened { dataset, plan, info, ..Opened::clone(opened) };
            out.snapshot.opened = Some(Arc::new(opened));
            out.is_changed = true;
        }
        self.cameras_updated = Some(Instant::now());
    }

    /// Publishes deferred changes once when training becomes idle (see [`Outbox::mark_visibility`]).
    fn publish_at_rest(&mut self, is_waiting: bool, run: &Run, out: &mut Outbox) {
        match self.waiting_since {
            _ if !is_waiting => self.waiting_since = Some(Instant::now()),
            Some(since) if since.elapsed() > AT_REST => {
                self.waiting_since = None;
                out.reset_frame_rate();
                out.mark_visibility(run);
                out.is_changed = true;
            }
            Some(_) | None => {}
        }
    }
}

/// Creates a reader that follows the recording in a folder and selects all frames.
pub fn follow_of(path: &Path, reading: &LoadOptions) -> Result<Follow, String> {
    let selection = Selection { follow: true, ..Selection::all_frames() };
    Follow::new(path, reading, &selection).map_err(|error| error.to_string())
}

/// True if `dataset` was read from the folder `subject`. Compares with the paths known since the dataset
/// was opened, because accessing the file system would block if the drive does not respond.
pub fn is_read_from(dataset: &Dataset, subject: &Subject) -> bool {
    matches!(subject, Subject::Path(path) if dataset.is_folder && dataset.path.as_ref() == Some(path))
}

/// True if `subject` is a folder, which need not exist. False for checkpoints and other files.
pub fn is_folder(subject: &Subject) -> bool {
    matches!(subject, Subject::Path(path) if !path.is_file() && !is_checkpoint(path))
}
