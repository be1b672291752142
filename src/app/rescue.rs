//! Rescue of the scene after a panic.
//!
//! A panic must not lose training. The training thread survives panics of the window and catches its
//! own, so it always saves the scene: beside the dataset, where it is found first, else in the
//! platform's state folder, else in the folder of temporary files.

use super::panic_report::PanicReport;
use super::user_folders;
use std::fmt;
use std::path::{Path, PathBuf};

/// Thread that panicked.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrashedThread {
    /// The window's thread.
    Window,
    /// The training thread.
    Training,
}

/// Panic, with the outcome of the rescue.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{} crashed: {panic}; {rescue}", match thread {
    CrashedThread::Window => "the window",
    CrashedThread::Training => "training",
})]
pub struct Crash {
    /// Thread that panicked.
    pub thread: CrashedThread,
    /// Message and location of the panic.
    pub panic: PanicReport,
    /// Outcome of the rescue.
    pub rescue: Rescue,
}

/// Outcome of a rescue.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rescue {
    /// There was no unsaved training.
    Nothing,
    /// The scene was saved to a checkpoint.
    Saved {
        /// File of the checkpoint.
        path: PathBuf,
        /// Number of frames trained since the previous checkpoint, all of them included.
        frames: usize,
    },
    /// The scene could not be saved.
    Lost {
        /// Number of frames trained since the previous checkpoint.
        frames: usize,
        /// Reasons, one for each folder that was tried.
        problems: Vec<String>,
    },
}

impl fmt::Display for Rescue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => write!(f, "no training was unsaved"),
            Self::Saved { path, frames } => {
                let path = path.display();
                write!(
                    f,
                    "the scene with its {frames} unsaved frames is in {path}: open that file to go on"
                )
            }
            Self::Lost { frames, problems } => {
                let problems = problems.join("; ");
                write!(
                    f,
                    "the scene with its {frames} unsaved frames could not be saved: {problems}"
                )
            }
        }
    }
}

/// Folders to try after the one beside the dataset.
pub fn fallback_folders() -> Vec<PathBuf> {
    user_folders::state().into_iter().chain([std::env::temp_dir()]).collect()
}

/// Writes `<stem>-rescued.vbgs`, or a numbered name if that exists, to the first folder that accepts
/// it. Missing fallback folders are created.
///
/// # Errors
/// The error of `write` for each folder.
pub fn save(
    beside: Option<&Path>,
    fallbacks: &[PathBuf],
    stem: &str,
    mut write: impl FnMut(&Path) -> Result<(), String>,
) -> Result<PathBuf, Vec<String>> {
    let mut problems = Vec::new();
    let fallbacks = fallbacks.iter().map(|folder| (folder.as_path(), true));
    for (folder, is_ours) in beside.map(|folder| (folder, false)).into_iter().chain(fallbacks) {
        // A dataset's folder is never created: if it is missing, its disk may be disconnected.
        if is_ours {
            // If this fails, `write` returns the more specific error.
            let _ = std::fs::create_dir_all(folder);
        }
        let path = free_path(folder, stem);
        match write(&path) {
            Ok(()) => return Ok(path),
            Err(problem) => problems.push(problem),
        }
    }
    Err(problems)
}

fn free_path(folder: &Path, stem: &str) -> PathBuf {
    let mut path = folder.join(format!("{stem}-rescued.vbgs"));
    let mut number = 2;
    // Of the link itself, because a dangling link would also be replaced.
    while path.symlink_metadata().is_ok() {
        path = folder.join(format!("{stem}-rescued-{number}.vbgs"));
        number += 1;
    }
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_folder_that_takes_the_file_gets_it_and_no_file_is_replaced() {
        let folder = tempfile::tempdir().unwrap();
        let (gone, state) = (folder.path().join("gone"), folder.path().join("state/vbgs"));
        let write = |path: &Path| std::fs::write(path, "scene").map_err(|e| format!("a: {e}"));
        let fallbacks = [state.clone()];
        for name in ["room-rescued.vbgs", "room-rescued-2.vbgs", "room-rescued-3.vbgs"] {
            let saved = save(Some(&gone), &fallbacks, "room", write);
            assert_eq!(saved.unwrap(), state.join(name));
        }
        assert!(!gone.exists(), "a dataset's folder is not created anew");
        let saved = save(Some(folder.path()), &fallbacks, "room", write).unwrap();
        assert_eq!(saved, folder.path().join("room-rescued.vbgs"));
        let problems = save(Some(&gone), &[saved.join("file")], "room", write).unwrap_err();
        assert_eq!(problems.len(), 2, "{problems:?}");
    }

    #[test]
    fn a_crash_says_what_happened_and_where_the_scene_is() {
        let panic = PanicReport { message: "boom".into(), place: Some("a.rs:1:2".into()) };
        let saved = Rescue::Saved { path: "/x/room-rescued.vbgs".into(), frames: 3 };
        let crash = Crash { thread: CrashedThread::Window, panic: panic.clone(), rescue: saved };
        assert_eq!(
            crash.to_string(),
            "the window crashed: boom (a.rs:1:2); the scene with its 3 unsaved frames is in /x/room-rescued.vbgs: open that file to go on"
        );
        let lost = Rescue::Lost { frames: 1, problems: vec!["full".into(), "gone".into()] };
        let crash = Crash { thread: CrashedThread::Training, panic, rescue: lost };
        assert!(crash.to_string().ends_with("could not be saved: full; gone"), "{crash}");
    }
}
