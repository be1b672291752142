//! Jobs: work on a separate thread with a single result, which the starting thread polls or discards.
//!
//! A drive that does not respond blocks only the job's thread. A panic is returned like a result.

use super::panic_report::PanicReport;
use std::io;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::sync::mpsc::{Receiver, sync_channel};
use std::thread::Builder;
use std::time::{Duration, Instant};

/// Callback that wakes the thread that polls a job, such as a window's thread.
pub type Waker = Arc<dyn Fn() + Send + Sync>;

/// Job whose work runs on its own thread. Dropping the job requests cancellation through its
/// [`Progress`] and discards the result.
///
/// ```
/// use std::time::Duration;
/// use vbgs_studio::pipeline::job::Job;
///
/// let job = Job::start("sum", || (1..=4).sum::<u32>())?;
/// assert_eq!(job.wait(Duration::MAX).expect("a result")?, 10);
/// assert!(job.poll().is_none(), "the result is available once");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Job<T> {
    started: Instant,
    progress: Arc<Progress>,
    results: Receiver<Result<T, PanicReport>>,
}

impl<T: Send + 'static> Job<T> {
    /// Starts `work` on a thread named `name`.
    ///
    /// # Errors
    /// The system cannot start a thread.
    pub fn start(name: &str, work: impl FnOnce() -> T + Send + 'static) -> io::Result<Self> {
        Self::start_reporting(name, Arc::new(|| ()), |_| work())
    }

    /// Starts work as [`Self::start`] does, and calls `waker` once the result is available.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_waking(
        name: &str,
        waker: Waker,
        work: impl FnOnce() -> T + Send + 'static,
    ) -> io::Result<Self> {
        Self::start_reporting(name, waker, |_| work())
    }

    /// Starts work as [`Self::start_waking`] does. The work receives a [`Progress`] to report progress
    /// and detect cancellation.
    ///
    /// # Errors
    /// As [`Self::start`].
    pub fn start_reporting(
        name: &str,
        waker: Waker,
        work: impl FnOnce(&Progress) -> T + Send + 'static,
    ) -> io::Result<Self> {
        // One slot, so that the thread ends without waiting for a reader.
        let (answer, results) = sync_channel(1);
        let progress = Arc::new(Progress::default());
        progress.begin();
        let reported = progress.clone();
        Builder::new().name(name.to_owned()).spawn(move || {
            // Unwind safe: after a panic only the report is used, no state of `work`.
            let done = catch_unwind(AssertUnwindSafe(|| work(&reported)));
            // Fails if the job was abandoned.
            let _ = answer.send(done.map_err(|panic| PanicReport::of(&*panic)));
            // Called after a panic too, or an idle window would not repaint.
            waker();
        })?;
        Ok(Self { started: Instant::now(), progress, results })
    }

    /// Returns the result of the work, or its panic, once. `None` before it is available and after it
    /// was returned.
    pub fn poll(&self) -> Option<Result<T, PanicReport>> {
        self.results.try_recv().ok()
    }

    /// Returns the result as [`Self::poll`] does, after waiting at most `patience` for it.
    pub fn wait(&self, patience: Duration) -> Option<Result<T, PanicReport>> {
        self.results.recv_timeout(patience).ok()
    }
}

impl<T> Job<T> {
    /// Time since the start of the work.
    pub fn elapsed(&self) -> Duration {
        self.started.elapsed()
    }

    /// Returns the shared progress, through which the work can be cancelled.
    pub fn progress(&self) -> &Progress {
        &self.progress
    }
}

impl<T> Drop for Job<T> {
    fn drop(&mut self) {
        self.progress.cancel();
    }
}

/// Value of `Progress::done` while there is no work.
const NONE: u32 = u32::MAX;
/// Value of `Progress::done` for completed work.
const WHOLE: f64 = 1000.0;

/// Progress and cancellation of work, shared by the working and the observing thread.
#[derive(Debug)]
pub struct Progress {
    /// Completed fraction of the work in thousandths, or [`NONE`].
    // An integer, because std has no atomic floats.
    done: AtomicU32,
    is_cancelled: AtomicBool,
}

impl Default for Progress {
    fn default() -> Self {
        Self { done: AtomicU32::new(NONE), is_cancelled: AtomicBool::new(false) }
    }
}

// Relaxed throughout: no other memory depends on these values.
impl Progress {
    /// Marks work as started, with a completed fraction of 0; clears an earlier cancellation.
    pub fn begin(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    /// Sets the completed fraction of the work, from 0 to 1. Returns true if the change is worth a
    /// redraw.
    pub fn set_share(&self, share: f64) -> bool {
        let done = (share.clamp(0.0, 1.0) * WHOLE) as u32;
        // Whole percents, so that a window is not redrawn for every thousandth.
        self.done.swap(done, Ordering::Relaxed) / 10 != done / 10
    }

    /// True unless the work was cancelled.
    pub fn is_wanted(&self) -> bool {
        !self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Marks work as ended, whether it is complete or not.
    pub fn end(&self) {
        self.done.store(NONE, Ordering::Relaxed);
    }

    /// Completed fraction of the work, from 0 to 1; `None` while there is no work.
    pub fn share(&self) -> Option<f32> {
        let done = self.done.load(Ordering::Relaxed);
        (done != NONE).then(|| (f64::from(done) / WHOLE) as f32)
    }

    /// Requests cancellation of the work.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::mpsc::channel;

    const PATIENCE: Duration = Duration::from_secs(60);

    /// Runs a job and returns its result, read after the waker was called.
    fn answer(work: impl FnOnce() -> usize + Send + 'static) -> Result<usize, PanicReport> {
        PanicReport::install_hook();
        let (woken, wakes) = channel();
        let waker: Waker = Arc::new(move || woken.send(()).unwrap());
        let job = Job::start_waking("test", waker, work).unwrap();
        wakes.recv_timeout(PATIENCE).expect("the window is woken");
        let answer = job.poll().expect("a result after the wake-up");
        assert!(job.poll().is_none(), "once");
        answer
    }

    #[test]
    fn a_result_and_a_panic_both_wake_the_window() {
        assert_eq!(answer(|| 7), Ok(7));
        let panic = answer(|| panic!("job test: {}", 3)).unwrap_err();
        assert_eq!(panic.message, "job test: 3");
        assert!(panic.place.unwrap().contains("job.rs:"), "where");
    }

    #[test]
    fn a_silent_job_is_not_waited_for_and_an_abandoned_one_is_cancelled() {
        let (speak, silence) = channel::<u32>();
        let (ended, ends) = channel();
        let job = Job::start_reporting("test", Arc::new(|| ()), move |progress| {
            let value = silence.recv().unwrap();
            ended.send(progress.is_wanted()).unwrap();
            value
        });
        let job = job.unwrap();
        assert!(job.wait(Duration::from_millis(1)).is_none());
        drop(job);
        speak.send(7).unwrap();
        assert!(!ends.recv_timeout(PATIENCE).unwrap());
    }

    #[test]
    fn only_the_current_work_is_cancelled() {
        let progress = Progress::default();
        assert_eq!(progress.share(), None);
        progress.cancel();
        progress.begin();
        assert!(progress.set_share(0.25) && progress.is_wanted());
        assert!(!progress.set_share(0.252), "not drawn again for less than a hundredth");
        assert_eq!(progress.share(), Some(0.252));
        progress.cancel();
        assert!(progress.set_share(0.5) && !progress.is_wanted());
        progress.end();
        assert_eq!(progress.share(), None);
    }
}
