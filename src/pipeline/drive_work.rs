//! Work that asks drives, which may never answer: on a thread of its own, so that whoever waits for it can
//! give it up.
//!
//! Nothing can end a thread that waits for a network drive that is gone. One that is given up stays behind
//! with what it waits for, and is heard no more.

use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, Builder};
use std::time::{Duration, Instant};

/// Work that is under way; dropping it lets the work go on unheard.
pub struct DriveWork<T> {
    since: Instant,
    answers: Receiver<thread::Result<T>>,
}

impl<T: Send + 'static> DriveWork<T> {
    /// Starts the work on a thread with this name.
    ///
    /// # Errors
    /// What the system says where it has no thread to spare.
    pub fn start(name: &str, work: impl FnOnce() -> T + Send + 'static) -> io::Result<Self> {
        let (answer, answers) = sync_channel(1);
        Builder::new().name(name.to_owned()).spawn(move || {
            // Nothing that the work may have left half done is used afterwards but its answer, for
            // which nobody listens where it was given up.
            let _ = answer.send(catch_unwind(AssertUnwindSafe(work)));
        })?;
        Ok(Self { since: Instant::now(), answers })
    }

    /// What came of it, or the panic that ended it, if it ends within that time; once.
    pub fn wait(&self, patience: Duration) -> Option<thread::Result<T>> {
        match self.answers.recv_timeout(patience) {
            Ok(ended) => Some(ended),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                let ended: Box<dyn Any + Send> = Box::new("the thread has ended unheard");
                Some(Err(ended))
            }
        }
    }

    /// How long ago it was started.
    pub fn elapsed(&self) -> Duration {
        self.since.elapsed()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pipeline::panic_text::panic_text;
    use std::sync::mpsc::channel;

    const PATIENCE: Duration = Duration::from_secs(60);

    #[test]
    fn answers_and_panics_come_and_silence_is_not_waited_for() {
        let (speak, silence) = channel::<u32>();
        let work = DriveWork::start("test", move || silence.recv().unwrap()).unwrap();
        assert!(work.wait(Duration::from_millis(1)).is_none());
        speak.send(7).unwrap();
        assert_eq!(work.wait(PATIENCE).unwrap().unwrap(), 7);
        let work = DriveWork::start("test", || panic!("injected into work: {}", 3)).unwrap();
        let ended: thread::Result<()> = work.wait(PATIENCE).unwrap();
        assert_eq!(panic_text(&*ended.unwrap_err()), Some("injected into work: 3"));
    }
}
