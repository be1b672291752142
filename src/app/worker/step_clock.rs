//! How long the trainer is at one frame, or waits for it: reading hangs with its drive, which nothing can end,
//! and the window says so.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// At no frame.
const NONE: u64 = u64::MAX;

/// Shared by the training thread and the window.
pub struct StepClock {
    origin: Instant,
    /// When the frame was begun, milliseconds after the origin, or [`NONE`].
    begun_ms: AtomicU64,
}

/// The trainer is at a frame until this is dropped, by a panic as well.
pub struct AtFrame<'a>(&'a StepClock);

impl Default for StepClock {
    fn default() -> Self {
        Self { origin: Instant::now(), begun_ms: AtomicU64::new(NONE) }
    }
}

// Relaxed throughout: the number stands for itself.
impl StepClock {
    /// A frame is begun.
    pub fn begin(&self) -> AtFrame<'_> {
        self.end();
        self.wait();
        AtFrame(self)
    }

    /// The trainer waits, since now unless it did before.
    pub fn wait(&self) {
        let now = self.origin.elapsed().as_millis() as u64;
        let _ = self.begun_ms.compare_exchange(NONE, now, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Its waiting is over.
    pub fn end(&self) {
        self.begun_ms.store(NONE, Ordering::Relaxed);
    }

    /// For how long the trainer has been at one frame; `None` while it is at none.
    pub fn at_frame(&self) -> Option<Duration> {
        let begun = self.begun_ms.load(Ordering::Relaxed);
        let begun = (begun != NONE).then(|| Duration::from_millis(begun))?;
        Some(self.origin.elapsed().saturating_sub(begun))
    }
}

impl Drop for AtFrame<'_> {
    fn drop(&mut self) {
        self.0.end();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_runs_while_a_frame_is_trained() {
        let clock = StepClock::default();
        assert_eq!(clock.at_frame(), None);
        let at_frame = clock.begin();
        std::thread::sleep(Duration::from_millis(20));
        assert!(clock.at_frame().is_some_and(|time| time >= Duration::from_millis(15)));
        drop(at_frame);
        assert_eq!(clock.at_frame(), None);
    }

    #[test]
    fn waiting_goes_on_until_it_ends() {
        let clock = StepClock::default();
        clock.wait();
        std::thread::sleep(Duration::from_millis(20));
        clock.wait();
        assert!(clock.at_frame().is_some_and(|time| time >= Duration::from_millis(15)));
        clock.end();
        assert_eq!(clock.at_frame(), None);
    }
}
