//! What the training thread and the window share.

use super::file_progress::FileProgress;
use super::opening_wish::OpeningWish;
use super::step_clock::StepClock;
use crate::app::rescue::Crash;
use crate::app::splat_updates::SplatUpdates;
use crate::app::state::Snapshot;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::Duration;

/// Wakes the window after something was published.
pub type Waker = Arc<dyn Fn() + Send + Sync>;

/// What both see. Locks are held for one assignment or one clone, so that neither a panic nor a slow
/// reader on one side ever troubles the other.
#[derive(Default)]
pub struct Shared {
    snapshot: Mutex<Arc<Snapshot>>,
    /// Changed splats on their way to the viewport.
    pub updates: SplatUpdates,
    /// Least time between two snapshots, microseconds.
    interval_us: AtomicU64,
    crash: Mutex<Option<Crash>>,
    /// How far the file being exported is.
    pub file: FileProgress,
    /// Whether what is being opened is still wanted.
    pub opening: OpeningWish,
    /// How long the trainer is at one frame.
    pub step: StepClock,
    /// For how long the trainer waits for a frame that is not read yet.
    pub unread: StepClock,
    /// Files that were given a number.
    n_numbered: AtomicU64,
}

impl Shared {
    /// The newest snapshot.
    pub fn snapshot(&self) -> Arc<Snapshot> {
        self.snapshot.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Replaces the newest snapshot.
    pub fn publish(&self, snapshot: Snapshot) {
        *self.snapshot.lock().unwrap_or_else(PoisonError::into_inner) = Arc::new(snapshot);
    }

    /// Least time between two snapshots.
    pub fn interval(&self) -> Duration {
        // Relaxed here and below: the number stands for itself, no other memory depends on it.
        Duration::from_micros(self.interval_us.load(Ordering::Relaxed))
    }

    /// Changes the least time between two snapshots.
    pub fn set_interval(&self, interval: Duration) {
        self.interval_us.store(interval.as_micros() as u64, Ordering::Relaxed);
    }

    /// A number that no file was given before, from 1.
    pub fn new_number(&self) -> u64 {
        self.n_numbered.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// The latest panic of the training thread.
    pub fn crash(&self) -> Option<Crash> {
        self.crash.lock().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// Notes a panic of the training thread.
    pub fn crashed(&self, crash: Crash) {
        *self.crash.lock().unwrap_or_else(PoisonError::into_inner) = Some(crash);
    }
}
