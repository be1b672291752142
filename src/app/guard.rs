//! Runs a window and handles panics of its thread.

use super::exit::{Exit, ExitReason};
use super::panic_report::PanicReport;
use super::rescue::{Crash, CrashedThread};
use super::window_error::WindowError;
use super::worker::Worker;
use eframe::{App, CreationContext, NativeOptions};
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Attempts of running winit's event loop until a window is created.
const MAX_RUNS: usize = 3;

/// Result of creating a window's application.
type Created = Result<Box<dyn App>, Box<dyn Error + Send + Sync>>;

/// Opens a window with `options` and runs the application of `create`, [`guarded`], until it ends.
///
/// A panic unwinds through winit's event loop and leaves it in a running state. The next run of the loop
/// handles remaining events of the old window and ends at once without creating a window. The run after that
/// creates one.
///
/// # Errors
/// Those of [`guarded`]; also if no run created a window.
pub fn run_window(
    worker: &Worker,
    exit: &Exit,
    options: impl Fn() -> NativeOptions,
    create: impl FnOnce(&CreationContext<'_>) -> Created,
) -> Result<(), WindowError> {
    let mut create = Some(create);
    for _ in 0..MAX_RUNS {
        let waiting = &mut create;
        let creator = move |context: &CreationContext<'_>| match waiting.take() {
            Some(create) => create(context),
            None => Err("one run of the event loop created two windows".into()),
        };
        let run = || Ok(eframe::run_native("vbgs-studio", options(), Box::new(creator))?);
        run_guarded(worker, exit, run)?;
        if create.is_none() {
            return Ok(());
        }
    }
    Err(WindowError::Window("the event loop ended before it created a window".to_owned()))
}

/// Runs a window until it ends. A panic after a device loss, which the window records in `exit`, is a
/// consequence of the loss and not an error: the caller opens the next window. Any other panic is a bug; no
/// window is reopened, since it could panic on the same picture forever.
///
/// # Errors
/// [`WindowError::Crashed`] with the path of the rescued scene, or the error of `window`.
pub fn run_guarded(
    worker: &Worker,
    exit: &Exit,
    window: impl FnOnce() -> Result<(), WindowError>,
) -> Result<(), WindowError> {
    // Unwind safe: all state shared with the worker is written in single assignments.
    match catch_unwind(AssertUnwindSafe(window)) {
        Ok(ended) => ended,
        // The device cannot be polled here: it was dropped with the window, which polled it last
        // (`Studio::drop`).
        Err(_) if exit.reason() == ExitReason::DeviceLost => Ok(()),
        Err(payload) => Err(WindowError::Crashed(Box::new(Crash {
            thread: CrashedThread::Window,
            panic: PanicReport::of(&*payload),
            rescue: worker.rescue(),
        }))),
    }
}
