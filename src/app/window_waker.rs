//! Wakes a window from threads that may outlive it.
//!
//! With egui's context go the last shapes, with them what draws, the device and the graphics driver. A thread
//! that held the context might be the last to let go of it: the driver would be unloaded beside a process
//! that ends, which is a crash. So threads hold a place where the context is looked up.

use super::worker::Waker;
use eframe::egui::Context;
use std::sync::{Arc, Mutex, PoisonError};

/// The window to wake, while there is one; none any more once this is dropped.
pub struct WindowWaker {
    place: Arc<Mutex<Option<Context>>>,
    waker: Waker,
}

impl Default for WindowWaker {
    /// No window yet.
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
    /// Of a window.
    pub fn of(context: &Context) -> Self {
        let waker = Self::default();
        waker.open(context.clone());
        waker
    }

    /// Wakes this window from now on.
    pub fn open(&self, context: Context) {
        self.put(Some(context));
    }

    /// Wakes none from now on.
    pub fn close(&self) {
        self.put(None);
    }

    fn put(&self, context: Option<Context>) {
        let mut place = self.place.lock().unwrap_or_else(PoisonError::into_inner);
        let before = std::mem::replace(&mut *place, context);
        // Dropped without the lock: much may go with it.
        drop(place);
        drop(before);
    }

    /// For threads, which may keep it: wakes whichever window is open then.
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
