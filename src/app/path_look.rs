//! Check of what exists at a path, on a separate thread: a drive that does not respond must not block
//! the window.

use super::background_job::BackgroundJob;
use super::panic_report::PanicReport;
use super::worker::Waker;
use eframe::egui::Ui;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What exists where a file is to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupant {
    Nothing,
    /// A file or link, which would be replaced.
    File,
    Folder,
}

/// Check of a path, which may take as long as its drive needs.
pub struct PathCheck {
    pub path: PathBuf,
    since: Instant,
    job: BackgroundJob<Occupant>,
}

/// Time after which the dialog shows what it waits for.
const HINT_DELAY: Duration = Duration::from_secs(1);

impl Occupant {
    fn of(path: &Path) -> Self {
        // A dangling link counts as a file, because it would be replaced.
        match (path.is_dir(), path.symlink_metadata().is_ok()) {
            (true, _) => Self::Folder,
            (false, true) => Self::File,
            (false, false) => Self::Nothing,
        }
    }
}

impl PathCheck {
    /// Starts the check; `waker` is called when it is done.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn start(path: PathBuf, waker: Waker) -> std::io::Result<Self> {
        let looked_at = path.clone();
        let job = BackgroundJob::start("dialog", waker, move || Occupant::of(&looked_at))?;
        Ok(Self { path, since: Instant::now(), job })
    }

    /// Takes the result, once.
    pub fn take(&self) -> Option<Result<Occupant, PanicReport>> {
        self.job.poll()
    }

    /// Shows what the dialog waits for, if that takes long.
    pub fn show_waiting(&self, ui: &mut Ui) {
        match HINT_DELAY.checked_sub(self.since.elapsed()) {
            Some(rest) => ui.ctx().request_repaint_after(rest),
            None => {
                let folder = self.path.parent().unwrap_or(&self.path).display();
                ui.label(format!(
                    "{folder}: the drive has not responded yet; wait, or choose another folder"
                ));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_folders_and_links_to_nowhere_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.ply");
        assert_eq!(Occupant::of(&file), Occupant::Nothing);
        std::fs::write(&file, "").unwrap();
        assert_eq!(Occupant::of(&file), Occupant::File);
        assert_eq!(Occupant::of(folder.path()), Occupant::Folder);
        #[cfg(unix)]
        {
            let link = folder.path().join("link.ply");
            std::os::unix::fs::symlink(folder.path().join("gone"), &link).unwrap();
            assert_eq!(Occupant::of(&link), Occupant::File);
        }
    }
}
