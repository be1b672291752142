//! Progress and cancellation of the file that the training thread writes. Not in snapshots, because the
//! thread that publishes them is the one that writes.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

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

#[cfg(test)]
mod tests {
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
