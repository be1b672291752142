//! Opens the window; without one, falls back to headless training.

use super::failure::Failure;
use super::interrupt::Interrupt;
use super::train;
use std::path::PathBuf;
use std::time::Instant;
use vbgs_studio::app;
use vbgs_studio::app::adapters::AdapterChoice;
use vbgs_studio::app::state::Subject;
use vbgs_studio::app::{WindowError, adapters};

/// Opens the window. Falls back to training the demo headless if there is no display or usable adapter.
pub fn run(
    path: Option<PathBuf>,
    calibration: Option<PathBuf>,
    adapter: Option<&str>,
    started: Instant,
) -> Result<(), Failure> {
    let adapter = adapter.map(AdapterChoice::parse);
    if let Some(choice) = &adapter {
        // Checked before the window opens: a wrong name is a usage error and must not start the demo.
        let unknown = |e: adapters::UnknownAdapter| usage!("--{e}");
        adapters::choose(choice, &adapters::list()).map_err(unknown)?;
    }
    if let Some(missing) = path.as_ref().filter(|path| !path.exists()) {
        return Err(failed!(
            "{}: expected a dataset, checkpoint or splat file, found nothing there; check the name",
            missing.display()
        ));
    }
    let subject = path.clone().map_or(Subject::Demo, Subject::Path);
    let interrupt = Interrupt::listen()?;
    let is_ended = move |longest| interrupt.wait_for_request(longest);
    end(app::run(subject, calibration, adapter, is_ended, started), path)
}

/// Converts the window's result to the result of the program. `path` is the opened file or folder, or
/// `None` for the demo.
fn end(ended: Result<(), WindowError>, path: Option<PathBuf>) -> Result<(), Failure> {
    match (ended, path) {
        (Ok(()), _) => Ok(()),
        // Training the demo headless would hide the program's error.
        (Err(error @ (WindowError::Crashed(_) | WindowError::Gone(..))), _) => {
            Err(Failure::failed(error))
        }
        (Err(error), None) => train::run_demo(&error.to_string()),
        (Err(error), Some(path)) => Err(failed!(
            "{}: {error}, so it cannot be opened in a window; use `train`, `eval`, `render`, `export` or `info`",
            path.display()
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::ExitCode;
    use vbgs_studio::app::rescue::{Crash, CrashedThread, Rescue};
    use vbgs_studio::pipeline::panic_report::PanicReport;

    /// Returns the exit code as text, because exit codes cannot be compared.
    fn status(ended: Result<(), WindowError>, path: Option<PathBuf>) -> String {
        format!("{:?}", end(ended, path).map_or_else(Failure::report, |()| ExitCode::SUCCESS))
    }

    fn crash(thread: CrashedThread) -> Result<(), WindowError> {
        let panic = PanicReport { message: "boom".into(), place: Some("a.rs:1:1".into()) };
        Err(WindowError::Crashed(Box::new(Crash { thread, panic, rescue: Rescue::Nothing })))
    }

    #[test]
    fn a_crash_ends_with_status_1_and_a_closed_window_with_0() {
        for thread in [CrashedThread::Window, CrashedThread::Training] {
            for path in [None, Some(PathBuf::from("room"))] {
                assert_eq!(status(crash(thread), path), format!("{:?}", ExitCode::FAILURE));
            }
        }
        assert_eq!(status(Ok(()), None), format!("{:?}", ExitCode::SUCCESS));
        assert_ne!(format!("{:?}", ExitCode::SUCCESS), format!("{:?}", ExitCode::FAILURE));
        let lost = Err(WindowError::DeviceLost(4));
        assert_eq!(status(lost, Some("room".into())), format!("{:?}", ExitCode::FAILURE));
    }
}
