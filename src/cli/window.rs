//! Opens the window; without one, falls back to headless training.

use super::failure::Failure;
use super::interrupt::Interrupt;
use super::{demo, output};
use std::path::{Path, PathBuf};
use std::time::Instant;
use vbgs_studio::app;
use vbgs_studio::app::adapters::AdapterChoice;
use vbgs_studio::app::state::{NoticeKind, Subject};
use vbgs_studio::app::unattended::Unattended;
use vbgs_studio::app::{WindowError, adapters};

/// Output folder of a run that lost its window.
const FOLDER: &str = "vbgs-unattended";

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
        let unknown = |e: adapters::UnknownAdapter| Failure::Usage(format!("--{e}"));
        adapters::choose(choice, &adapters::list()).map_err(unknown)?;
    }
    let subject = path.clone().map_or(Subject::Demo, Subject::Path);
    let interrupt = Interrupt::listen()?;
    let is_ended = move |longest| interrupt.wait_for_request(longest);
    end(app::run(subject, calibration, adapter, is_ended, started), path)
}

/// Converts the window's result to that of the program; `path` is what it was opened on, `None` for the demo.
fn end(ended: Result<(), WindowError>, path: Option<PathBuf>) -> Result<(), Failure> {
    match (ended, path) {
        (Ok(()), _) => Ok(()),
        // Training the demo headless would hide the program's error.
        (Err(error @ WindowError::Crashed(_)), _) => Err(Failure::failed(error)),
        (Err(WindowError::Gone(error, run)), _) => continue_headless(&error, run),
        (Err(error), None) => demo::run(&error.to_string()),
        (Err(error), Some(path)) => Err(Failure::failed(anyhow::anyhow!(
            "{}: {error}, so it cannot be opened in a window; use `train`, `eval`, `render`, `export` or `info`",
            path.display()
        ))),
    }
}

/// Trains a run that lost its window to its end and writes its files.
fn continue_headless(reason: &WindowError, run: Unattended) -> Result<(), Failure> {
    output::print_line(format!(
        "{reason}: the run continues without a window, output in {FOLDER}/"
    ));
    output::create_folder(Path::new(FOLDER))?;
    let notices = run.finish(Path::new(FOLDER));
    match notices.iter().find(|(kind, _)| *kind == NoticeKind::Error) {
        Some((_, text)) => Err(Failure::failed(anyhow::anyhow!("{text}"))),
        None => {
            notices.iter().for_each(|(_, text)| output::print_line(text));
            Ok(())
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::process::ExitCode;
    use vbgs_studio::app::panic_report::PanicReport;
    use vbgs_studio::app::rescue::{Crash, CrashedThread, Rescue};

    /// Exit codes cannot be compared, but formatted.
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

    #[test]
    fn the_message_of_a_crash_is_its_own() {
        let Err(Failure::Failed(error)) = end(crash(CrashedThread::Window), None) else {
            panic!("a failure");
        };
        assert_eq!(
            error.to_string(),
            "the window crashed: boom (a.rs:1:1); no training was unsaved"
        );
    }
}
