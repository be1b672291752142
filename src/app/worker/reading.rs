//! Reading what somebody wants opened, from disks that may not answer.
//!
//! A network drive that is gone blocks whoever asks it for a file, for minutes or for ever, and nothing can
//! end that. So a thread of its own asks, and the training thread waits for it only as long as the user
//! does.

use super::opening_work::{opened, start_opening};
use super::thread::WorkerThread;
use crate::app::state::{NoticeKind, NoticeTopic};
use std::path::Path;
use std::time::Duration;

/// How often it is looked whether the user still waits.
const LOOK: Duration = Duration::from_millis(50);
/// After so long without an answer the user is told.
const SLOW: Duration = Duration::from_secs(4);

/// Why something was not opened.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refusal {
    /// How bad it is: the user's own wish is no error.
    pub kind: NoticeKind,
    /// The text.
    pub text: String,
}

impl From<String> for Refusal {
    fn from(text: String) -> Self {
        Self { kind: NoticeKind::Error, text }
    }
}

impl WorkerThread {
    /// What `work` finds at a path, or [`Refusal`] where the user gives it up.
    pub(super) fn read<T: Send + 'static>(
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
                return Ok(opened(&name, ended)?);
            }
            if self.shared.opening.is_given_up() {
                let text = format!("{name}: given up before it was open, as asked");
                return Err(Refusal { kind: NoticeKind::Info, text });
            }
            if !is_told && work.elapsed() > SLOW {
                is_told = true;
                self.tell_of_silence(&name, work.elapsed());
            }
        }
    }

    fn tell_of_silence(&mut self, name: &str, elapsed: Duration) {
        let text = format!(
            "{name}: expected to have it open, found no end of reading after {} s; a drive may be slow or gone: wait, or press Cancel opening below and check the drive",
            elapsed.as_secs()
        );
        // Of the subject: once it is open after all, this goes.
        self.notify_of(NoticeTopic::Subject, NoticeKind::Warning, text);
        self.publish(true);
    }
}
