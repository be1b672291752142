//! State shared by the training thread and the window.

use super::file_progress::FileProgress;
use super::opening_wish::OpeningCancellation;
use super::step_clock::StepClock;
use crate::app::rescue::Crash;
use crate::app::splat_updates::SplatUpdates;
use crate::app::state::Snapshot;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
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
