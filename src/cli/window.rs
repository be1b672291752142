//! The window, and what happens where there is none.

use super::demo;
use super::failure::Failure;
use super::output;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vbgs_studio::app::adapters::{self, AdapterChoice};
use vbgs_studio::app::state::{NoticeKind, Subject};
use vbgs_studio::app::unattended::Unattended;
use vbgs_studio::app::{self, WindowError};

/// Folder of a run that lost its window.
const FOLDER: &str = "vbgs-unattended";

/// Opens the window; the demo falls back to headless training where there is no display or no
/// usable adapter.
pub fn run(
    path: Option<PathBuf>,
    calibration: Option<PathBuf>,
    adapter: Option<&str>,
    started: Instant,
) -> Result<(), Failure> {
    let adapter = adapter.map(AdapterChoice::parse);
    if let Some(choice) = &adapter {
        let unknown = |e: adapters::UnknownAdapter| Failure::Usage(format!("--{e}"));
        adapters::choose(choice, &adapters::list()).map_err(unknown)?;
    }
    let subject = path.clone().map_or(Subject::Demo, Subject::Path);
    match (app::run(subject, calibration, adapter, started), path) {
        (Ok(()), _) => Ok(()),
        (Err(WindowError::Gone(error, run)), _) => go_on(&error, run),
        (Err(error), None) => demo::run(&error.to_string()),
        (Err(error), Some(path)) => Err(Failure::failed(anyhow::anyhow!(
            "{}: {error}, so it cannot be opened in a window; use `train`, `eval`, `render`, `export` or `info`",
            path.display()
        ))),
    }
}

/// Lets a run that lost its window train to its end and writes what it learned.
fn go_on(reason: &WindowError, run: Unattended) -> Result<(), Failure> {
    output::line(format!("{reason}: the run goes on without a window into {FOLDER}/"));
    output::create_folder(Path::new(FOLDER))?;
    let notices = run.finish(Path::new(FOLDER));
    match notices.iter().find(|(kind, _)| *kind == NoticeKind::Error) {
        Some((_, text)) => Err(Failure::failed(anyhow::anyhow!("{text}"))),
        None => {
            notices.iter().for_each(|(_, text)| output::line(text));
            Ok(())
        }
    }
}
