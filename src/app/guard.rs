//! What a panic of the window's thread means.

use super::exit::{Exit, Leave};
use super::panic_report::PanicReport;
use super::rescue::{Crash, CrashedThread};
use super::window_error::WindowError;
use super::worker::Worker;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs a window to its end. A panic after the device was lost is that loss's, of which the window has
/// left word in `exit`, and the next window goes on. Any other panic is a fault of the program, after
/// which no window is opened again: it could panic at the same picture for ever.
///
/// # Errors
/// [`WindowError::Crashed`] with where the worker saved the scene; else what `window` returns.
pub fn guarded(
    worker: &Worker,
    exit: &Exit,
    window: impl FnOnce() -> Result<(), WindowError>,
) -> Result<(), WindowError> {
    // Safe to go on from: the window shares with the worker only what is written in one assignment.
    match catch_unwind(AssertUnwindSafe(window)) {
        Ok(ended) => ended,
        // The device itself cannot be asked here: it went down with the
        // window, which asked it last.
        Err(_) if exit.why() == Leave::DeviceLost => Ok(()),
        Err(payload) => Err(WindowError::Crashed(Box::new(Crash {
            thread: CrashedThread::Window,
            panic: PanicReport::of(&*payload),
            rescue: worker.rescue(),
        }))),
    }
}
