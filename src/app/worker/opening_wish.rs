//! Cancellation of an opening, set by the window.

use std::sync::atomic::{AtomicBool, Ordering};

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

#[cfg(test)]
mod tests {
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
