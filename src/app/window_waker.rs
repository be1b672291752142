//! Wakes a window from threads that may outlive it.
//!
//! Dropping egui's context drops the last shapes, and with them the painter, the device and the
//! graphics driver. A thread that dropped the context last would unload the driver while the process
//! exits, which crashes. Threads therefore hold a slot from which the context is read.

use super::worker::Waker;
use eframe::egui::Context;
use std::sync::{Arc, Mutex, PoisonError};

/// Slot of the window to wake, which is emptied when this is dropped.
pub struct WindowWaker {
    place: Arc<Mutex<Option<Context>>>,
    waker: Waker,
}

impl Default for WindowWaker {
    fn default() -> Self {
        let place: Arc<Mutex<Option<Context>>> = Arc::default();
        let looked_up = place.clone();
        let waker = Arc::new(move || {
            if let Some(context) = &*looked_up.lock().unwrap_or_else(PoisonError::into_inner) {
                context.request_repaint();
            }
        });
        Self { place, waker }
    }
}

impl WindowWaker {
    pub fn of(context: &Context) -> Self {
        let waker = Self::default();
        waker.open(context.clone());
        waker
    }

    /// Wakes this window from now on.
    pub fn open(&self, context: Context) {
        self.put(Some(context));
    }

    /// Wakes no window from now on.
    pub fn close(&self) {
        self.put(None);
    }

    fn put(&self, context: Option<Context>) {
        let mut place = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *place, context);
        // Dropped without the lock, because much may be dropped with the context.
        drop(place);
        drop(before);
    }

    /// Waker for threads: wakes the window that is open at that time.
    pub fn waker(&self) -> &Waker {
        &self.waker
    }
}

impl Drop for WindowWaker {
    fn drop(&mut self) {
        self.close();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_waker_outlives_its_window_and_holds_nothing_of_it() {
        let context = Context::default();
        let (held, asked) = (Arc::new(()), Arc::new(Mutex::new(0)));
        let (of_window, counter) = (held.clone(), asked.clone());
        context.set_request_repaint_callback(move |_| {
            let _ = &of_window;
            *counter.lock().unwrap() += 1;
        });
        let window = WindowWaker::of(&context);
        let waker = window.waker().clone();
        waker();
        assert_eq!(*asked.lock().unwrap(), 1);
        drop(window);
        waker();
        assert_eq!(*asked.lock().unwrap(), 1, "nobody is woken");
        drop(context);
        assert_eq!(Arc::strong_count(&held), 1, "and nothing of the window is held");
    }
}
