//! What a panic of the window's thread means.

use super::exit::{Exit, Leave};
use super::panic_report::PanicReport;
use super::rescue::{Crash, CrashedThread};
use super::window_error::WindowError;
use super::worker::Worker;
use eframe::{App, CreationContext, NativeOptions};
use std::error::Error;
use std::panic::{AssertUnwindSafe, catch_unwind};

/// Runs of winit's loop to get a window.
const MAX_RUNS: usize = 3;

/// What makes the application of a window.
type Created = Result<Box<dyn App>, Box<dyn Error + Send + Sync>>;

/// Opens a window by `options` and runs what `create` makes for it to its end, [`guarded`].
///
/// A panic goes through winit's loop and leaves it as if it still ran: the next run handles what is left of
/// the window before, ends at once as if the user had closed one, and makes no window at all. The run after
/// that does.
///
/// # Errors
/// As [`guarded`]; also if no run made a window.
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
            None => Err("one run of the loop made two windows".into()),
        };
        let run = || Ok(eframe::run_native("vbgs-studio", options(), Box::new(creator))?);
        guarded(worker, exit, run)?;
        if create.is_none() {
            return Ok(());
        }
    }
    Err(WindowError::Window("the event loop ended before there was a window".to_owned()))
}

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
