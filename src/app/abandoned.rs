//! Where the window saves runs on their way, and what earlier windows have left there.
//!
//! A run has a slot: a file named after its dataset, in the platform's folder for what programs
//! remember, and a locked file beside it as long as its window lives. A process loses its locks
//! however it ends, so a file that nobody has locked is of a window that was killed before its user
//! was asked about it. A slot that holds such a file is not used for another run: progress is never
//! discarded unasked.

use crate::pipeline::checkpoint::SavedRun;
use std::fs::{File, TryLockError};
use std::io;
use std::path::{Path, PathBuf, absolute};
use std::time::SystemTime;

/// Runs of one dataset that can wait to be gone on with.
const MAX_SLOTS: usize = 100;
const ENDING: &str = "vbgs";

/// A place for one run's saves, nobody else's as long as this lives.
pub struct AutosaveSlot {
    path: PathBuf,
    /// Held and never written: the lock is what counts.
    _lock: File,
}

impl AutosaveSlot {
    /// A slot in which nothing is, for a run on a dataset; the folder is created where it is missing.
    ///
    /// # Errors
    /// The folder takes no files, or all its slots for this dataset wait to be gone on with.
    pub fn claim(folder: &Path, dataset: &Path) -> io::Result<Self> {
        std::fs::create_dir_all(folder)?;
        for n in 1..=MAX_SLOTS {
            let path = folder.join(slot_name(dataset, n));
            if let Some(slot) = Self::take(&path)?
                && !path.exists()
                && !backup(&path).exists()
            {
                return Ok(slot);
            }
        }
        Err(io::Error::other(format!("expected a free slot, found {MAX_SLOTS} saved runs")))
    }

    /// The slot of a file that was left behind; `None` while another window has it.
    ///
    /// # Errors
    /// The lock cannot be created.
    pub fn take(path: &Path) -> io::Result<Option<Self>> {
        let lock = File::create(path.with_extension("lock"))?;
        match lock.try_lock() {
            Err(TryLockError::WouldBlock) => Ok(None),
            // Some file systems know no locks: two windows on one dataset are rarer than these.
            Ok(()) | Err(TryLockError::Error(_)) => {
                Ok(Some(Self { path: path.to_owned(), _lock: lock }))
            }
        }
    }

    /// The file.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Removes what was saved: the run is in a file of the user's choice, or is not wanted any more.
    pub fn discard(self) {
        for path in [&self.path, &backup(&self.path), &self.path.with_extension("lock")] {
            // What cannot be removed is offered again, which is no harm.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// A run that was saved on its way and then neither ended nor given up.
#[derive(Clone, Debug, PartialEq)]
pub struct AbandonedRun {
    /// Its slot's file.
    pub slot: PathBuf,
    /// The file that can be read: the slot's, or the one before it.
    pub file: PathBuf,
    /// Folder of its dataset.
    pub dataset: PathBuf,
    /// Frames learnt that are in it.
    pub frames: u64,
    /// Frames the run was to go through.
    pub planned_frames: usize,
}

/// The newest run that was left behind in a folder, of one dataset or of any.
pub fn find(folder: &Path, dataset: Option<&Path>) -> Option<AbandonedRun> {
    let dataset = dataset.map(full);
    let mut slots: Vec<(SystemTime, PathBuf)> =
        std::fs::read_dir(folder).ok()?.flatten().filter_map(|entry| slot(&entry.path())).collect();
    slots.sort();
    // Newest first. Checkpoints are large, so of the others not even a byte is read.
    let mut slots = slots.into_iter().rev().map(|(_, path)| path);
    slots.find_map(|path| {
        let is_meant = dataset.as_ref().is_none_or(|dataset| is_slot_of(&path, dataset));
        let is_free = is_meant && matches!(AutosaveSlot::take(&path), Ok(Some(_)));
        is_free.then(|| read(&path)).flatten().filter(|run| {
            // Its name is a checksum's word; the file knows.
            dataset.as_ref().is_none_or(|dataset| run.dataset == *dataset)
        })
    })
}

/// A slot's file that exists, or whose older file does, and when it was written.
fn slot(path: &Path) -> Option<(SystemTime, PathBuf)> {
    let path = match path.extension()?.to_str()? {
        ENDING => path.to_owned(),
        "bak" => path.with_extension(""),
        _ => return None,
    };
    let file = if path.exists() { path.clone() } else { backup(&path) };
    Some((file.metadata().ok()?.modified().ok()?, path))
}

/// What can be read of a slot.
fn read(path: &Path) -> Option<AbandonedRun> {
    [path.to_owned(), backup(path)].into_iter().find_map(|file| {
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

/// The file before, as [`Autosave`](crate::pipeline::autosave::Autosave) keeps it.
fn backup(path: &Path) -> PathBuf {
    path.with_added_extension("bak")
}

/// `<dataset>-<checksum of its path>`, then its number from the second on.
fn slot_name(dataset: &Path, n: usize) -> String {
    let stem = stem(&full(dataset));
    if n == 1 { format!("{stem}.{ENDING}") } else { format!("{stem}-{n}.{ENDING}") }
}

fn is_slot_of(path: &Path, dataset: &Path) -> bool {
    path.file_name().and_then(|n| n.to_str()).is_some_and(|name| name.starts_with(&stem(dataset)))
}

fn stem(dataset: &Path) -> String {
    let name = dataset.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
    let plain: String = name.chars().filter(|c| c.is_ascii_alphanumeric() || *c == '_').collect();
    format!("{plain}-{:08x}", crc32fast::hash(dataset.as_os_str().as_encoded_bytes()))
}

/// As checkpoints name their dataset.
fn full(path: &Path) -> PathBuf {
    absolute(path).unwrap_or_else(|_| path.to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slots_are_taken_once_and_never_while_something_waits_in_them() {
        let folder = tempfile::tempdir().unwrap();
        let (state, room) = (folder.path().join("autosave"), folder.path().join("my room"));
        let first = AutosaveSlot::claim(&state, &room).unwrap();
        let second = AutosaveSlot::claim(&state, &room).unwrap();
        let name = first.path().file_stem().unwrap().to_str().unwrap().to_owned();
        assert!(name.starts_with("myroom-"), "{name}");
        assert_eq!(second.path(), state.join(format!("{name}-2.vbgs")));
        std::fs::write(first.path(), "a run").unwrap();
        assert!(AutosaveSlot::take(first.path()).unwrap().is_none(), "locked");
        let kept = first.path().to_owned();
        drop(first);
        let third = AutosaveSlot::claim(&state, &room).unwrap();
        assert_eq!(third.path(), state.join(format!("{name}-3.vbgs")));
        assert!(AutosaveSlot::take(&kept).unwrap().is_some(), "left behind");
        for slot in [second, third, AutosaveSlot::take(&kept).unwrap().unwrap()] {
            slot.discard();
        }
        assert_eq!(std::fs::read_dir(&state).unwrap().count(), 0);
        assert_eq!(find(&state, None), None);
    }
}
