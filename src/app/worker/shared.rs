//! State shared by the training thread and the window.

use crate::app::mailbox::Mailbox;
use crate::app::rescue::Crash;
use crate::app::splat_updates::SplatUpdates;
use crate::app::state::Snapshot;
use crate::pipeline::job::Progress;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU64, Ordering};
use std::time::Duration;

#[derive(Default)]
pub struct Shared {
    pub snapshot: Mailbox<Arc<Snapshot>>,
    pub updates: SplatUpdates,
    pub crash: Mailbox<Option<Crash>>,
    /// The file being exported.
    pub file: Progress,
    pub opening: Progress,
    is_closing: AtomicBool,
    interval_us: AtomicU64,
    n_numbered: AtomicU64,
}

// Relaxed throughout: no other memory depends on the values.
impl Shared {
    /// Minimum time between two snapshots.
    pub fn interval(&self) -> Duration {
        Duration::from_micros(self.interval_us.load(Ordering::Relaxed))
    }

    pub fn set_interval(&self, interval: Duration) {
        // 64 bits hold any interval in microseconds.
        self.interval_us.store(interval.as_micros() as u64, Ordering::Relaxed);
    }

    /// Returns an unused file number, from 1.
    pub fn new_number(&self) -> u64 {
        self.n_numbered.fetch_add(1, Ordering::Relaxed) + 1
    }

    /// Cancels this opening and all later ones, because the program ends.
    pub fn close(&self) {
        self.is_closing.store(true, Ordering::Relaxed);
    }

    pub fn is_opening_wanted(&self) -> bool {
        self.opening.is_wanted() && !self.is_closing.load(Ordering::Relaxed)
    }
}
