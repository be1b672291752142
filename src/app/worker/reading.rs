//! Reads a subject from drives that may not respond.
//!
//! A disconnected network drive blocks a read for minutes or forever, and nothing can end that. A
//! separate thread reads, and the training thread waits for it only until the user cancels.

use super::opening_work::{join_opening, start_opening};
use super::thread::WorkerThread;
use crate::app::state::{NoticeKind, NoticeTopic};
use std::path::Path;
use std::time::Duration;

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
