//! Autosave slots of training runs, and the rescue of a run when the program ends unexpectedly.
//!
//! A run has one slot in the platform's state folder: a checkpoint named after the dataset, and a lock file
//! beside it. The lock file is locked while the window is open; the lock is released however the process
//! ends. A checkpoint without a locked lock file therefore belongs to a window that closed before the user
//! saved or discarded the run. The program offers this run at its next startup, and never reuses the slot
//! for another run. It offers checkpoints in the same way that `train` left in the state folder itself, because
//! it could not write them to their own.

use super::opening::absolute_or_same;
use super::user_folders;
use crate::pipeline::checkpoint::SavedRun;
use crate::pipeline::panic_report::PanicReport;
use std::fmt;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

/// Maximum number of slots of one dataset, occupied ones included.
const MAX_SLOTS: usize = 100;
const ENDING: &str = "vbgs";
/// Name of the subfolder that contains the slots.
const FOLDER: &str = "autosave";

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CrashedThread {
    Window,
    Training,
}

/// Panic of a thread, and the outcome of storing unsaved training.
#[derive(Clone, Debug, thiserror::Error)]
#[error("{} crashed: {panic}; {rescue}", match thread {
    CrashedThread::Window => "the window",
    CrashedThread::Training => "training",
})]
pub struct Crash {
    pub thread: CrashedThread,
    pub panic: PanicReport,
    pub rescue: Rescue,
}

/// Outcome of storing frames that no checkpoint contains.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Rescue {
    Nothing,
    Stored {
        path: PathBuf,
        frames: usize,
    },
    /// The frames could not be stored. Holds one problem for each folder that was tried.
    Lost {
        frames: usize,
        problems: Vec<String>,
    },
}

impl fmt::Display for Rescue {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Nothing => write!(f, "no training was unsaved"),
            Self::Stored { path, frames } => {
                let path = path.display();
                let scene = unsaved_scene(*frames);
                write!(f, "{scene} is in {path}: the next start offers to continue it")
            }
            Self::Lost { frames, problems } => {
                let problems = problems.join("; ");
                write!(f, "{} could not be saved: {problems}", unsaved_scene(*frames))
            }
        }
    }
}

fn unsaved_scene(frames: usize) -> String {
    match frames {
        0 => "the scene with its unsaved scale, level or coordinates".to_owned(),
        _ => format!("the scene with its {frames} unsaved frames"),
    }
}

/// Returns the folders for autosaves, in order of preference.
pub fn default_folders() -> Vec<PathBuf> {
    // The last resort: the state folder may be missing, full or read-only.
    let temporary = std::env::temp_dir().join(user_folders::APP);
    user_folders::state().into_iter().chain([temporary]).collect()
}

/// Checkpoint path reserved for the autosaves of one run. It stays locked until this value is dropped.
pub struct AutosaveSlot {
    path: PathBuf,
    /// Lock file, open to hold the lock; nothing is written to it.
    _lock: File,
}

impl AutosaveSlot {
    /// Returns an empty, locked slot below `folder` for a run on `dataset`.
    ///
    /// # Errors
    /// The folder is not writable, or all 100 slots of this dataset hold unfinished runs.
    pub fn claim(folder: &Path, dataset: &Path) -> io::Result<Self> {
        let folder = folder.join(FOLDER);
        std::fs::create_dir_all(&folder)?;
        for n in 1..=MAX_SLOTS {
            let path = folder.join(slot_name(dataset, n));
            // Locked before the check, or another window could claim the slot in between.
            if let Some(slot) = Self::lock_existing(&path)?
                && !path.exists()
                && !backup_path(&path).exists()
            {
                return Ok(slot);
            }
        }
        Err(io::Error::other(format!(
            "expected a free autosave slot, found {MAX_SLOTS} unfinished runs of this dataset; resume or discard some"
        )))
    }

    /// Locks the slot whose checkpoint path is `path`. `None` if another window holds the lock.
    ///
    /// # Errors
    /// The lock file cannot be created.
    pub fn lock_existing(path: &Path) -> io::Result<Option<Self>> {
        let lock = File::create(path.with_extension("lock"))?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => Ok(None),
            // Some file systems have no locks. Two windows on one dataset are rarer than those.
            Ok(()) | Err(TryLockError::Error(_)) => {
                Ok(Some(Self { path: path.to_owned(), _lock: lock }))
            }
        }
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Deletes the checkpoint, its backup and the lock file, after the run was saved elsewhere or
    /// discarded.
    pub fn delete_files(self) {
        for path in [&self.path, &backup_path(&self.path), &self.path.with_extension("lock")] {
            // A file that cannot be removed is only offered again at the next startup.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Autosaved run of an earlier window that closed before the user saved or discarded the run.
#[derive(Clone, Debug, PartialEq)]
pub struct AbandonedRun {
    /// Checkpoint path of the slot. The file may be missing if only its backup exists.
    pub slot: PathBuf,
    /// Readable checkpoint: the file of the slot or its backup.
    pub file: PathBuf,
    pub dataset: PathBuf,
    pub frames: u64,
    pub planned_frames: usize,
}

/// Finds the newest abandoned run in `folders` that was trained on `dataset`, or on any dataset if
/// `dataset` is `None`.
pub fn find_newest(folders: &[PathBuf], dataset: Option<&Path>) -> Option<AbandonedRun> {
    // Absolute, as checkpoints store their dataset.
    let dataset = dataset.map(absolute_or_same);
    let list = |folder: PathBuf| {
        let entries = std::fs::read_dir(folder).into_iter().flatten().flatten();
        entries.filter_map(|entry| slot_modified(&entry.path()))
    };
    let mut slots: Vec<(SystemTime, PathBuf)> =
        folders.iter().flat_map(|folder| list(folder.join(FOLDER))).collect();
    let beside = folders.iter().flat_map(|folder| list(folder.clone()));
    slots.extend(beside.filter(|(_, path)| is_rescued(path)));
    slots.sort();
    // Newest first, and lazily: checkpoints are large, so older ones are not read at all.
    let mut slots = slots.into_iter().rev().map(|(_, path)| path);
    slots.find_map(|path| {
        let may_be = |dataset| is_slot_of(&path, dataset) || is_rescued(&path);
        let is_meant = dataset.as_deref().is_none_or(may_be);
        // A locked slot belongs to a window that is still open.
        let is_free = is_meant && matches!(AutosaveSlot::lock_existing(&path), Ok(Some(_)));
        is_free.then(|| read_run(&path)).flatten().filter(|run| {
            // The file name holds at most a checksum of the dataset's path, which may collide.
            dataset.as_ref().is_none_or(|dataset| run.dataset == *dataset)
        })
    })
}

/// Returns the modification time and the checkpoint path of the slot to which a file belongs. `None` unless
/// the file is a checkpoint or a backup.
fn slot_modified(path: &Path) -> Option<(SystemTime, PathBuf)> {
    let path = match path.extension()?.to_str()? {
        ENDING => path.to_owned(),
        // A backup is named after its slot: `<slot>.vbgs.bak`.
        "bak" => path.with_extension(""),
        _ => return None,
    };
    let file = if path.exists() { path.clone() } else { backup_path(&path) };
    Some((file.metadata().ok()?.modified().ok()?, path))
}

fn read_run(path: &Path) -> Option<AbandonedRun> {
    // A crash may have damaged the newer file.
    [path.to_owned(), backup_path(path)].into_iter().find_map(|file| {
        let run = SavedRun::read(&file).ok()?;
        Some(AbandonedRun {
            slot: path.to_owned(),
            file,
            dataset: run.meta.dataset?,
            frames: run.content.cursor.frames,
            planned_frames: run.meta.planned_frames,
        })
    })
}

/// Returns the path of the previous version of the checkpoint, written by
/// [`Autosave`](crate::pipeline::autosave::Autosave).
fn backup_path(path: &Path) -> PathBuf {
    path.with_added_extension("bak")
}

/// Returns the file name `<dataset>-<checksum of its path>.vbgs` of slot `n`. Slots after the first have
/// their number appended.
fn slot_name(dataset: &Path, n: usize) -> String {
    let stem = stem(&absolute_or_same(dataset));
    if n == 1 { format!("{stem}.{ENDING}") } else { format!("{stem}-{n}.{ENDING}") }
}

/// Beginning of the name of a checkpoint that `train` could not write to its own folder; the process ID
/// follows.
const UNSAVED: &str = "unsaved-";
/// End of the name, before the extension, of a checkpoint that a crash of `train` left.
const RESCUED: &str = "-rescued";

fn is_rescued(path: &Path) -> bool {
    let stem = path.file_stem().and_then(|stem| stem.to_str());
    stem.is_some_and(|stem| stem.starts_with(UNSAVED) || stem.contains(RESCUED))
}

fn is_slot_of(path: &Path, dataset: &Path) -> bool {
    // Further slots of a dataset have a number after the stem.
    path.file_name().and_then(|n| n.to_str()).is_some_and(|name| name.starts_with(&stem(dataset)))
}

fn stem(dataset: &Path) -> String {
    let name = dataset.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    // Only characters that every file system accepts.
    let plain: String = name.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    // Datasets in different folders may have the same name.
    format!("{plain}-{:08x}", crc32fast::hash(dataset.as_os_str().as_encoded_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_taken_once_and_never_while_something_waits_in_them() {
        let folder = tempfile::tempdir().unwrap();
        let (state, room) = (folder.path().join("state"), folder.path().join("my room"));
        let slots = state.join(FOLDER);
        let first = AutosaveSlot::claim(&state, &room).unwrap();
        let second = AutosaveSlot::claim(&state, &room).unwrap();
        let name = first.path().file_stem().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with("myroom-"), "{name}");
        assert_eq!(second.path(), slots.join(format!("{name}-2.vbgs")));
        std::fs::write(first.path(), "a run").unwrap();
        assert!(AutosaveSlot::lock_existing(first.path()).unwrap().is_none(), "locked");
        let kept = first.path().to_owned();
        drop(first);
        let third = AutosaveSlot::claim(&state, &room).unwrap();
        assert_eq!(third.path(), slots.join(format!("{name}-3.vbgs")));
        assert!(AutosaveSlot::lock_existing(&kept).unwrap().is_some(), "left behind");
        for slot in [second, third, AutosaveSlot::lock_existing(&kept).unwrap().unwrap()] {
            slot.delete_files();
        }
        assert_eq!(std::fs::read_dir(&slots).unwrap().count(), 0);
        assert_eq!(find_newest(&[state], None), None);
    }
}
