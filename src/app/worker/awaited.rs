//! A recording of which nothing is open yet: whether its first frames are there, and the session that begins
//! on them.
//!
//! A session looks at some of its frames before it begins. A drive that falls silent there would hold the
//! training thread, so that a thread of its own begins it, waited for in small patience.

use super::opening_work::{opened, start_opening};
use crate::app::opening::{self, Content, OpenError, OpenedSubject};
use crate::app::training::TrainSettings;
use crate::pipeline::drive_work::DriveWork;
use crate::pipeline::follow::{Follow, silence};
use crate::pipeline::session::Session;
use std::time::Duration;

/// For how long a session that begins is waited for before orders are looked for again.
const PATIENCE: Duration = Duration::from_millis(50);

/// A recording that no session was begun on yet.
pub(super) struct AwaitedRecording {
    follow: Follow,
    /// The session that begins on the frames so far.
    beginning: Option<DriveWork<Result<OpenedSubject, OpenError>>>,
}

impl AwaitedRecording {
    /// Looked at from now on.
    pub fn new(follow: Follow) -> Self {
        Self { follow, beginning: None }
    }

    /// What is followed.
    pub fn follow(&self) -> &Follow {
        &self.follow
    }

    /// Time until the next look.
    pub fn rest(&self) -> Duration {
        if self.beginning.is_some() { Duration::ZERO } else { self.follow.rest() }
    }

    /// Why nothing comes, where that is not for lack of new files.
    pub fn problem(&self) -> Option<String> {
        let beginning = self.beginning.as_ref();
        let silence = beginning.and_then(|work| silence(self.follow.path(), work.elapsed()));
        silence.or_else(|| self.follow.problem().map(str::to_owned))
    }

    /// What begins on the first frames, trained as is said, once they are there and it has begun; to be
    /// followed from there on. `serial` numbers it.
    ///
    /// # Errors
    /// What keeps it from ever beginning.
    pub fn look(
        &mut self,
        training: &TrainSettings,
        serial: u64,
    ) -> Result<Option<OpenedSubject>, String> {
        let work = match self.beginning.take() {
            Some(work) => work,
            None => match self.begin(training, serial)? {
                Some(work) => work,
                None => return Ok(None),
            },
        };
        let Some(ended) = work.wait(PATIENCE) else {
            self.beginning = Some(work);
            return Ok(None);
        };
        match opened(&self.follow.path().display().to_string(), ended)? {
            Ok(begun) => Ok(Some(begun)),
            Err(OpenError::Session(error)) if self.follow.forgives(&error) => Ok(None),
            Err(error) => Err(error.to_string()),
        }
    }

    /// Begins a session, if there are more frames than when one was tried before.
    fn begin(
        &mut self,
        training: &TrainSettings,
        serial: u64,
    ) -> Result<Option<DriveWork<Result<OpenedSubject, OpenError>>>, String> {
        let Some(dataset) = self.follow.more().map_err(|error| error.to_string())? else {
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

    /// Hands what has begun the frames to come.
    pub fn hand_over(self, begun: &mut OpenedSubject) {
        if let Content::Session(session) = &mut begun.content {
            session.follow(Some(self.follow));
        }
    }
}
