//! Recording without a session: waits for the first frames and starts a session on them.
//!
//! A session reads some of its frames before it starts. A drive that does not respond would block the
//! training thread, so a separate thread starts the session and is polled.

use super::shared::{join_opening, start_opening};
use crate::app::opening;
use crate::app::opening::{Content, OpenError, OpenedSubject};
use crate::app::training::TrainSettings;
use crate::pipeline::follow::{Follow, silence};
use crate::pipeline::looks::DriveWork;
use crate::pipeline::session::Session;
use std::time::Duration;

/// Timeout of a poll of the starting session, after which orders are handled.
const PATIENCE: Duration = Duration::from_millis(50);

pub(super) struct AwaitedRecording {
    follow: Follow,
    /// Session being started on the frames so far.
    beginning: Option<DriveWork<Result<OpenedSubject, OpenError>>>,
}

impl AwaitedRecording {
    pub fn new(follow: Follow) -> Self {
        Self { follow, beginning: None }
    }

    pub fn follow(&self) -> &Follow {
        &self.follow
    }

    /// Time until the next poll.
    pub fn time_to_next_poll(&self) -> Duration {
        if self.beginning.is_some() { Duration::ZERO } else { self.follow.time_to_next_scan() }
    }

    /// Reason why no frames arrive, other than a lack of new files.
    pub fn problem(&self) -> Option<String> {
        let beginning = self.beginning.as_ref();
        let silence = beginning.and_then(|work| silence(self.follow.path(), work.elapsed()));
        silence.or_else(|| self.follow.problem().map(str::to_owned))
    }

    /// Returns the session once the first frames exist and it has started, trained with `training` and
    /// numbered `serial`.
    ///
    /// # Errors
    /// If no session can ever start.
    pub fn poll(
        &mut self,
        training: &TrainSettings,
        serial: u64,
    ) -> Result<Option<OpenedSubject>, String> {
        let work = match self.beginning.take() {
            Some(work) => work,
            None => match self.start_session(training, serial)? {
                Some(work) => work,
                None => return Ok(None),
            },
        };
        let Some(ended) = work.wait(PATIENCE) else {
            self.beginning = Some(work);
            return Ok(None);
        };
        match join_opening(&self.follow.path().display().to_string(), ended)? {
            Ok(begun) => Ok(Some(begun)),
            Err(OpenError::Session(error)) if self.follow.may_succeed_later(&error) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Starts a session, if there are more frames than at the last attempt.
    fn start_session(
        &mut self,
        training: &TrainSettings,
        serial: u64,
    ) -> Result<Option<DriveWork<Result<OpenedSubject, OpenError>>>, String> {
        let Some(dataset) = self.follow.poll_dataset().map_err(|error| error.to_string())? else {
            return Ok(None);
        };
        let request = training.request().map_err(|refused| refused.to_string())?;
        let (path, selection) = (self.follow.path().to_owned(), self.follow.selection().clone());
        let begins = move || {
            let session = Session::new(dataset, request, selection)?;
            Ok(opening::session(session, serial, Some(&path)))
        };
        start_opening(&self.follow.path().display().to_string(), begins).map(Some)
    }

    /// Lets the session follow the recording.
    pub fn hand_over(self, begun: &mut OpenedSubject) {
        if let Content::Session(session) = &mut begun.content {
            session.follow(Some(self.follow));
        }
    }
}
