//! Work that accesses drives, on its own thread, so that callers can abandon it.
//!
//! A thread that waits for a lost network drive cannot be stopped. An abandoned thread stays blocked, and its
//! result is discarded.

use std::any::Any;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, RecvTimeoutError, sync_channel};
use std::thread::{self, Builder};
use std::time::{Duration, Instant};

/// Work in progress; dropping it abandons the work.
pub struct DriveWork<T> {
    since: Instant,
    answers: Receiver<thread::Result<T>>,
}

impl<T: Send + 'static> DriveWork<T> {
    /// Starts the work on a thread with this name.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(name: &str, work: impl FnOnce() -> T + Send + 'static) -> io::Result<Self> {
        let (answer, answers) = sync_channel(1);
        Builder::new().name(name.to_owned()).spawn(move || {
            // Unwind-safe, because only the result is used afterwards. Sending fails if the work was
            // abandoned.
            let _ = answer.send(catch_unwind(AssertUnwindSafe(work)));
        })?;
        Ok(Self { since: Instant::now(), answers })
    }

    /// Waits up to `patience` for the result or the panic that ended the work; available once.
    pub fn wait(&self, patience: Duration) -> Option<thread::Result<T>> {
        match self.answers.recv_timeout(patience) {
            Ok(ended) => Some(ended),
            Err(RecvTimeoutError::Timeout) => None,
            Err(RecvTimeoutError::Disconnected) => {
                let ended: Box<dyn Any + Send> = Box::new("the thread ended without a result");
                Some(Err(ended))
            }
        }
    }

    /// Time since the start.
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
