//! What lies at a path, looked for beside the window: a drive that does not answer must not hold it up.

use super::background_job::BackgroundJob;
use super::panic_report::PanicReport;
use super::worker::Waker;
use eframe::egui::Ui;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

/// What lies where a file is to be written.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Occupant {
    /// Nothing so far.
    Nothing,
    /// Something that a file replaces.
    File,
    /// A folder.
    Folder,
}

/// A look at a path, which may take as long as its drive wants.
pub struct PathLook {
    /// Where.
    pub path: PathBuf,
    since: Instant,
    job: BackgroundJob<Occupant>,
}

/// After so long it is said what is waited for.
const SAID_AFTER: Duration = Duration::from_secs(1);

impl Occupant {
    fn of(path: &Path) -> Self {
        // A link that leads nowhere is a file too: it would be replaced.
        match (path.is_dir(), path.symlink_metadata().is_ok()) {
            (true, _) => Self::Folder,
            (false, true) => Self::File,
            (false, false) => Self::Nothing,
        }
    }
}

impl PathLook {
    /// Begins to look; `waker` is called once it is known.
    ///
    /// # Errors
    /// No thread could be started.
    pub fn start(path: PathBuf, waker: Waker) -> std::io::Result<Self> {
        let looked_at = path.clone();
        let job = BackgroundJob::start("dialog", waker, move || Occupant::of(&looked_at))?;
        Ok(Self { path, since: Instant::now(), job })
    }

    /// What is there, once, when it is known.
    pub fn take(&self) -> Option<Result<Occupant, PanicReport>> {
        self.job.take()
    }

    /// Says what is waited for, where that takes long.
    pub fn tell(&self, ui: &mut Ui) {
        match SAID_AFTER.checked_sub(self.since.elapsed()) {
            Some(rest) => ui.ctx().request_repaint_after(rest),
            None => {
                let folder = self.path.parent().unwrap_or(&self.path).display();
                ui.label(format!(
                    "{folder}: no answer yet; wait for its drive, or choose another folder"
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
