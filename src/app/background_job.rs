//! Work on a thread of its own with a single result that the window polls.
//!
//! A panic counts as a result and wakes the window too. If the thread merely closed its channel, an idle
//! window would not repaint until the pointer moved, and the cause would be lost.

use super::worker::Waker;
use crate::pipeline::panic_report::PanicReport;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, sync_channel};

/// Running work. Dropping this value does not stop the work; its result is discarded.
pub struct BackgroundJob<T>(Receiver<Result<T, PanicReport>>);

impl<T: Send + 'static> BackgroundJob<T> {
    /// Runs `work` on a thread named `name` and calls `waker` once the result is available.
    ///
    /// # Errors
    /// The thread cannot be started.
    pub fn start(
        name: &str,
        waker: Waker,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let (answer, answers) = sync_channel(1);
        std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            // Unwind safe: after a panic only the report is used, no state of `work`.
            let done =
                catch_unwind(AssertUnwindSafe(work)).map_err(|panic| PanicReport::of(&*panic));
            // The receiver is gone if the window dropped the job.
            let _ = answer.send(done);
            waker();
        })?;
        Ok(Self(answers))
    }

    /// Returns the result, or the panic that ended the work, once; `None` until it is available.
    pub fn poll(&self) -> Option<Result<T, PanicReport>> {
        self.0.try_recv().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// Result of a job, read after the waker was called.
    fn answer(work: impl FnOnce() -> usize + Send + 'static) -> Result<usize, PanicReport> {
        PanicReport::install_hook();
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || woken.send(()).unwrap());
        let job = BackgroundJob::start("test", waker, work).unwrap();
        wakes.recv_timeout(Duration::from_secs(60)).expect("the window is woken");
        let answer = job.poll().expect("a result after the wake-up");
        assert!(job.poll().is_none(), "once");
        answer
    }

    #[test]
    fn an_answer_and_a_panic_both_wake_the_window() {
        assert_eq!(answer(|| 7), Ok(7));
        let panic = answer(|| panic!("background test: {}", 3)).unwrap_err();
        assert_eq!(panic.message, "background test: 3");
        assert!(panic.place.unwrap().contains("background_job.rs:"), "where");
    }

    #[test]
    fn work_that_nobody_waits_for_ends_in_order() {
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || woken.send(()).unwrap());
        drop(BackgroundJob::start("test", waker, || 7).unwrap());
        wakes.recv_timeout(Duration::from_secs(60)).expect("the work ends");
    }
}
