//! How far the file is that the training thread is writing, and whether the user still wants it. Not
//! in snapshots: the thread that publishes them is the one that writes.

use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};

/// No file is being written.
const NONE: u32 = u32::MAX;
/// Parts of a whole file.
const WHOLE: f64 = 1000.0;

/// Shared by the thread that writes and the window.
pub struct FileProgress {
    /// Thousandths that are written, or [`NONE`].
    done: AtomicU32,
    is_cancelled: AtomicBool,
}

impl Default for FileProgress {
    fn default() -> Self {
        Self { done: AtomicU32::new(NONE), is_cancelled: AtomicBool::new(false) }
    }
}

// Relaxed throughout: each number stands for itself.
impl FileProgress {
    /// A file is begun; what was cancelled before was another.
    pub fn begin(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
        self.done.store(0, Ordering::Relaxed);
    }

    /// So much of it is written, 0 to 1; whether that is news worth drawing.
    pub fn tell(&self, share: f64) -> bool {
        let done = (share.clamp(0.0, 1.0) * WHOLE) as u32;
        self.done.swap(done, Ordering::Relaxed) / 10 != done / 10
    }

    /// Whether the user still wants it.
    pub fn is_wanted(&self) -> bool {
        !self.is_cancelled.load(Ordering::Relaxed)
    }

    /// The file is there, or was given up.
    pub fn end(&self) {
        self.done.store(NONE, Ordering::Relaxed);
    }

    /// The share that is written; `None` while no file is.
    pub fn share(&self) -> Option<f32> {
        let done = self.done.load(Ordering::Relaxed);
        (done != NONE).then(|| (f64::from(done) / WHOLE) as f32)
    }

    /// The user wants the file no more.
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
        assert!(progress.tell(0.25) && progress.is_wanted());
        assert!(!progress.tell(0.252), "not drawn again for less than a hundredth");
        assert_eq!(progress.share(), Some(0.252));
        progress.cancel();
        assert!(progress.tell(0.5) && !progress.is_wanted());
        progress.end();
        assert_eq!(progress.share(), None);
    }
}
