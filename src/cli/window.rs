//! The window, and what happens where there is none.

use super::demo;
use super::failure::Failure;
use std::path::PathBuf;
use std::time::Instant;
use vbgs_studio::app;
use vbgs_studio::app::state::Subject;

/// Opens the window; the demo falls back to headless training where there is no display or no
/// usable adapter.
pub fn run(path: Option<PathBuf>, started: Instant) -> Result<(), Failure> {
    let subject = path.clone().map_or(Subject::Demo, Subject::Path);
    match (app::run(subject, started), path) {
        (Ok(()), _) => Ok(()),
        (Err(error), None) => demo::run(&error.to_string()),
        (Err(error), Some(path)) => Err(Failure::failed(anyhow::anyhow!(
            "{}: {error}, so it cannot be opened in a window; use `train`, `eval`, `render`, `export` or `info`",
            path.display()
        ))),
    }
}
