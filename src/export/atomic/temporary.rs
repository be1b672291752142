//! Temporary files of atomic writes, and removal of those that a killed process left behind.
//!
//! The writing process holds a lock on its temporary file, and the system releases it however the process
//! ends. An unlocked temporary is therefore a leftover, on any machine or container. A process id would not
//! be enough: two containers may share one.

use super::destination::{Destination, folder_of};
use super::disk::SaveDisk;
use std::ffi::OsString;
use std::fs::File;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::path::{Path, PathBuf};

/// Number of names tried; the first is almost certainly free.
const NAME_TRIES: usize = 10;

/// Temporary name beside a file, removed on drop unless it was moved into place.
pub(super) struct Temporary<'a> {
    disk: &'a dyn SaveDisk,
    path: PathBuf,
    is_placed: bool,
}

impl<'a> Temporary<'a> {
    /// Creates an entry with `make` under the first free temporary name.
    fn first_free<T>(
        disk: &'a dyn SaveDisk,
        target: &Path,
        kind: &str,
        mut make: impl FnMut(&Path) -> io::Result<T>,
    ) -> io::Result<(Self, T)> {
        for _ in 0..NAME_TRIES {
            let path = new_name(target, kind);
            match make(&path) {
                Ok(made) => return Ok((Self { disk, path, is_placed: false }, made)),
                Err(e) if e.kind() == io::ErrorKind::AlreadyExists => {}
                Err(e) => return Err(e),
            }
        }
        Err(io::ErrorKind::AlreadyExists.into())
    }

    /// Creates a locked file in the target's folder: across file systems a rename is a copy, which can be
    /// interrupted.
    pub fn file(disk: &'a dyn SaveDisk, target: &Path) -> io::Result<(Self, File)> {
        Self::first_free(disk, target, "", |path| {
            let file = disk.create(path)?;
            // On a file system without locks, leftovers are not removed; nothing else depends on the lock.
            let is_locked = file.lock().is_ok();
            // Another process may have removed the file between creation and lock.
            match is_locked && !path.exists() {
                true => Err(io::ErrorKind::AlreadyExists.into()),
                false => Ok(file),
            }
        })
    }

    /// Creates a hard link to a file. It is not locked: if another process removes it and creates it again,
    /// it still refers to the same file, since only such links have this kind of name.
    pub fn hard_link(disk: &'a dyn SaveDisk, file: &Path) -> io::Result<Self> {
        Ok(Self::first_free(disk, file, ".old", |path| disk.link(file, path))?.0)
    }

    /// Renames the temporary to its final name, replacing any file there.
    pub fn rename_to(mut self, path: &Path) -> io::Result<()> {
        self.disk.rename(&self.path, path)?;
        // Renaming onto another link to the same file does nothing and leaves both names.
        self.is_placed = !self.path.exists();
        Ok(())
    }
}

impl Drop for Temporary<'_> {
    fn drop(&mut self) {
        if !self.is_placed {
            // A leftover only takes space until the next cleanup.
            let _ = self.disk.remove(&self.path);
        }
    }
}

/// Returns `.NAME.PROCESS.RANDOM.tmp` or, for links, `.NAME.PROCESS.RANDOM.old.tmp`.
fn new_name(target: &Path, kind: &str) -> PathBuf {
    // `RandomState` is seeded differently in every process and at every call.
    let random = RandomState::new().build_hasher().finish();
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}.{random:x}{kind}.tmp", std::process::id()));
    folder_of(target).join(name)
}

/// Removes temporary files of `path` left by killed processes; each is as large as the file. Files that a
/// process is still writing stay.
pub fn remove_leftovers(path: &Path) {
    let Ok(Destination::File(file)) = Destination::resolve(path) else { return };
    let Some(name) = file.file_name().and_then(|name| name.to_str()) else { return };
    let Ok(entries) = std::fs::read_dir(folder_of(&file)) else { return };
    for entry in entries.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && entry.file_name().to_str().is_some_and(|found| is_temporary(found, name)) {
            let Ok(left) = File::open(entry.path()) else { continue };
            if left.try_lock().is_ok() {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

/// True if `found` is named like a temporary of `name` or of its `.bak`, in this or an earlier version of the
/// program.
fn is_temporary(found: &str, name: &str) -> bool {
    let rest = found.strip_prefix('.').unwrap_or(found).strip_prefix(name);
    let rest = rest.map(|rest| rest.strip_prefix(".bak").unwrap_or(rest));
    let middle = rest.and_then(|rest| rest.strip_prefix('.')?.strip_suffix(".tmp"));
    let process = middle.and_then(|middle| middle.split('.').next()?.parse::<u32>().ok());
    process.is_some()
}

#[cfg(test)]
mod tests {
    use super::super::disk::SystemDisk;
    use super::*;

    #[test]
    fn only_what_nobody_writes_any_more_of_this_file_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vbgs");
        let left =
            [".a.vbgs.0.Ab3.tmp", ".a.vbgs.7.0.old.tmp", ".a.vbgs.bak.7.1.tmp", "a.vbgs.0.tmp"];
        let kept = ["a.vbgs", "a.vbgs.bak", "a.vbgs.notes.tmp", ".b.vbgs.0.Ab3.tmp"];
        left.iter().chain(&kept).for_each(|name| {
            std::fs::write(folder.path().join(name), "x").unwrap();
        });
        let written = Temporary::file(&SystemDisk, &path).unwrap();
        remove_leftovers(&path);
        assert!(left.iter().all(|name| !folder.path().join(name).exists()));
        assert!(kept.iter().all(|name| folder.path().join(name).exists()));
        assert!(written.0.path.exists(), "still being written");
        let second = Temporary::file(&SystemDisk, &path).unwrap();
        assert_ne!(second.0.path, written.0.path);
        drop((written, second));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), kept.len());
        remove_leftovers(&folder.path().join("none/a.vbgs"));
    }
}
