//! State shared by the training thread and the window.

use super::step_clock::StepClock;
use crate::app::rescue::Crash;
use crate::app::splat_updates::SplatUpdates;
use crate::app::state::Snapshot;
use crate::pipeline::looks::DriveWork;
use crate::pipeline::panic_report::PanicReport;
use std::sync::atomic::{AtomicBool, AtomicU32, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::thread;
use std::time::Duration;

/// Callback that wakes the window after something was published.
pub type Waker = Arc<dyn Fn() + Send + Sync>;

/// Shared state. Locks are held for one assignment or clone only, so that neither a panic nor a slow
/// reader on one side affects the other.
#[derive(Default)]
pub struct Shared {
    snapshot: Mutex<Arc<Snapshot>>,
    /// Mailbox of changed splats for the viewport.
    pub updates: SplatUpdates,
    interval_us: AtomicU64,
    crash: Mutex<Option<Crash>>,
    pub file: FileProgress,
    pub opening: OpeningCancellation,
    /// Time of the current step.
    pub step: StepClock,
    /// Time for which the trainer waits for a frame that has not been read.
    pub unread: StepClock,
    n_numbered: AtomicU64,
}

impl Shared {
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.snapshot.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn publish(&self, snapshot: Snapshot) {
        *self.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(snapshot);
    }

    pub fn interval(&self) -> Duration {
        // Relaxed here and below: no other memory depends on the number.
        Duration::from_micros(self.interval_us.load(Ordering::Relaxed))
    }

    pub fn set_interval(&self, interval: Duration) {
        self.interval_us.store(interval.as_micros() as u64, Ordering::Relaxed);
    }

    /// Returns an unused file number, from 1.
    pub fn new_number(&self) -> u64 {
        self.n_numbered.fetch_add(1, Ordering::Relaxed) + 1
    }

    pub fn crash(&self) -> Option<Crash> {
        self.crash.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    pub fn crashed(&self, crash: Crash) {
        *self.crash.lock().unwrap_or_else(PoisonError::into_inner) = Some(crash);
    }
}

/// Value of `done` while no file is being written.
const NONE: u32 = u32::MAX;
/// Number of steps of a whole file.
const WHOLE: f64 = 1000.0;

/// Progress of a file, shared by the writing thread and the window.
pub struct FileProgress {
    /// Thousandths written, or [`NONE`].
    done: AtomicU32,
    is_cancelled: AtomicBool,
}

impl Default for FileProgress {
    fn default() -> Self {
        Self { done: AtomicU32::new(NONE), is_cancelled: AtomicBool::new(false) }
    }
}

// Relaxed throughout: no other memory depends on these values.
impl FileProgress {
    /// Starts a file; clears the cancellation of an earlier one.
    pub fn begin(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    /// Sets the written share, from 0 to 1; true if it changed enough to redraw.
    pub fn set_share(&self, share: f64) -> bool {
        let done = (share.clamp(0.0, 1.0) * WHOLE) as u32;
        self.done.swap(done, Ordering::Relaxed) / 10 != done / 10
    }

    /// True unless the user has cancelled the file.
    pub fn is_wanted(&self) -> bool {
        !self.is_cancelled.load(Ordering::Relaxed)
    }

    /// Ends the file, whether it was written or not.
    pub fn end(&self) {
        self.done.store(NONE, Ordering::Relaxed);
    }

    /// Written share; `None` while no file is being written.
    pub fn share(&self) -> Option<f32> {
        let done = self.done.load(Ordering::Relaxed);
        (done != NONE).then(|| (f64::from(done) / WHOLE) as f32)
    }

    /// Cancels the file.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }
}

/// Cancellation of openings, shared by window and training thread.
#[derive(Default)]
pub struct OpeningCancellation {
    is_cancelled: AtomicBool,
    is_over: AtomicBool,
}

// Relaxed throughout: no other memory depends on the flags.
impl OpeningCancellation {
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Cancels this opening and all later ones, because the program ends.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Starts another opening; clears an earlier cancellation.
    pub fn begin(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
    }

    /// True if the opening was cancelled.
    pub fn is_cancelled(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed) || self.is_over.load(Ordering::Relaxed)
    }
}

/// Starts work that opens a subject.
///
/// # Errors
/// If no thread can be started.
pub(super) fn start_opening<T: Send + 'static>(
    name: &str,
    work: impl FnOnce() -> T + Send + 'static,
) -> Result<DriveWork<T>, String> {
    let n_threads = rayon::current_num_threads();
    let reads = move || {
        // In its own pool: a thread of the global pool that never returns would be missing for training
        // and drawing.
        match rayon::ThreadPoolBuilder::new().num_threads(n_threads).build() {
            Ok(pool) => pool.install(work),
            Err(_) => work(),
        }
    };
    DriveWork::start("opening", reads)
        .map_err(|error| format!("{name}: starting the thread that opens it failed: {error}"))
}

/// Result of the work, or the notice about its panic.
pub(super) fn join_opening<T>(name: &str, ended: thread::Result<T>) -> Result<T, String> {
    ended.map_err(|panic| {
        format!("{name}: {}", PanicReport::of(&*panic).failure_notice("opening it"))
    })
}

#[cfg(test)]
mod file_progress_tests {
    use super::*;

    #[test]
    fn only_the_file_being_written_is_cancelled() {
        let progress = FileProgress::default();
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

#[cfg(test)]
mod opening_wish_tests {
    use super::*;

    #[test]
    fn a_wish_is_given_up_once_and_an_end_is_for_good() {
        let wish = OpeningCancellation::default();
        wish.cancel();
        assert!(wish.is_cancelled());
        wish.begin();
        assert!(!wish.is_cancelled(), "what was cancelled was another");
        wish.end();
        wish.begin();
        assert!(wish.is_cancelled());
    }
}
