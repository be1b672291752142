//! A piece of work beside the window, on a thread of its own, whose one answer the window takes when it
//! is there.
//!
//! A panic of the work is an answer as well, and wakes the window like one. A thread that merely hung up
//! would leave a window at rest waiting until somebody moves the pointer, and nobody would learn why.

use super::panic_report::PanicReport;
use super::worker::Waker;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::mpsc::{Receiver, sync_channel};

/// Work that is under way; dropping it lets the work go on unheard.
pub struct BackgroundJob<T>(Receiver<Result<T, PanicReport>>);

impl<T: Send + 'static> BackgroundJob<T> {
    /// Starts the work on a thread with this name; `waker` is called once the answer is there.
    ///
    /// # Errors
    /// No thread could be started.
    pub fn start(
        name: &str,
        waker: Waker,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> std::io::Result<Self> {
        let (answer, answers) = sync_channel(1);
        std::thread::Builder::new().name(name.to_owned()).spawn(move || {
            // Nothing that the work may have left half done is used afterwards but its answer.
            let done =
                catch_unwind(AssertUnwindSafe(work)).map_err(|panic| PanicReport::of(&*panic));
            // Nobody listens any more if the window has something else to do by now.
            let _ = answer.send(done);
            waker();
        })?;
        Ok(Self(answers))
    }

    /// What the work answers, or the panic that ended it; once, when it is there.
    pub fn take(&self) -> Option<Result<T, PanicReport>> {
        self.0.try_recv().ok()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    /// A job's answer, taken no sooner than the window is woken.
    fn answer(work: impl FnOnce() -> usize + Send + 'static) -> Result<usize, PanicReport> {
        PanicReport::listen();
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || woken.send(()).unwrap());
        let job = BackgroundJob::start("test", waker, work).unwrap();
        wakes.recv_timeout(Duration::from_secs(60)).expect("the window is woken");
        let answer = job.take().expect("an answer that the window is woken for");
        assert!(job.take().is_none(), "once");
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
        wakes.recv_timeout(Duration::from_secs(60)).expect("it comes to its end");
    }
}
