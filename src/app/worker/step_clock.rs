//! Clock of the current frame. Reading blocks while a drive does not respond, which nothing can end;
//! the window shows the elapsed time.

use std::sync::atomic::{AtomicU64, Ordering};
use std::time::{Duration, Instant};

/// No frame is in progress.
const NONE: u64 = u64::MAX;

/// Clock shared by the training thread and the window.
pub struct StepClock {
    origin: Instant,
    /// Start of the frame, milliseconds after `origin`, or [`NONE`].
    begun_ms: AtomicU64,
}

/// Guard of a running clock; stops it when dropped, also by a panic.
pub struct AtFrame<'a>(&'a StepClock);

impl Default for StepClock {
    fn default() -> Self {
        Self { origin: Instant::now(), begun_ms: AtomicU64::new(NONE) }
    }
}

// Relaxed throughout: no other memory depends on the number.
impl StepClock {
    /// Restarts the clock for a frame.
    pub fn begin(&self) -> AtFrame<'_> {
        self.end();
        self.wait();
        AtFrame(self)
    }

    /// Starts the clock, unless it runs already.
    pub fn wait(&self) {
        let now = self.origin.elapsed().as_millis() as u64;
        let _ = self.begun_ms.compare_exchange(NONE, now, Ordering::Relaxed, Ordering::Relaxed);
    }

    /// Stops the clock.
    pub fn end(&self) {
        self.begun_ms.store(NONE, Ordering::Relaxed);
    }

    /// Elapsed time; `None` while the clock is stopped.
    pub fn elapsed(&self) -> Option<Duration> {
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
        assert_eq!(clock.elapsed(), None);
        let at_frame = clock.begin();
        std::thread::sleep(Duration::from_millis(20));
        assert!(clock.elapsed().is_some_and(|time| time >= Duration::from_millis(15)));
        drop(at_frame);
        assert_eq!(clock.elapsed(), None);
    }

    #[test]
    fn waiting_goes_on_until_it_ends() {
        let clock = StepClock::default();
        clock.wait();
        std::thread::sleep(Duration::from_millis(20));
        clock.wait();
        assert!(clock.elapsed().is_some_and(|time| time >= Duration::from_millis(15)));
        clock.end();
        assert_eq!(clock.elapsed(), None);
    }
}
