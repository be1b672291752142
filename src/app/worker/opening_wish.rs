//! Whether what is being opened is still wanted, which only the window knows.

use std::sync::atomic::{AtomicBool, Ordering};

/// Whether the user still wants what is being opened. Shared by window and training thread.
#[derive(Default)]
pub struct OpeningWish {
    is_cancelled: AtomicBool,
    is_over: AtomicBool,
}

// Relaxed throughout: each flag stands for itself.
impl OpeningWish {
    /// The user wants no more what is being opened now.
    pub fn cancel(&self) {
        self.is_cancelled.store(true, Ordering::Relaxed);
    }

    /// Nothing is wanted any more: the program ends.
    pub fn end(&self) {
        self.is_over.store(true, Ordering::Relaxed);
    }

    /// Something else is opened; what was cancelled before was another.
    pub fn begin(&self) {
        self.is_cancelled.store(false, Ordering::Relaxed);
    }

    /// Whether nobody waits for it any more.
    pub fn is_given_up(&self) -> bool {
        self.is_cancelled.load(Ordering::Relaxed) || self.is_over.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_wish_is_given_up_once_and_an_end_is_for_good() {
        let wish = OpeningWish::default();
        wish.cancel();
        assert!(wish.is_given_up());
        wish.begin();
        assert!(!wish.is_given_up(), "what was cancelled was another");
        wish.end();
        wish.begin();
        assert!(wish.is_given_up());
    }
}
