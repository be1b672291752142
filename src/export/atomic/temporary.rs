//! Files under names of their own until they are whole, and what a killed process leaves of them.
//!
//! A temporary is locked as long as its process writes it, and the system lifts the lock however the
//! process ends: one that nobody holds is a leftover, on whichever machine and in whichever container
//! its process ran. Process numbers alone would not tell, since two containers may share one.

use super::destination::{Destination, folder_of};
use super::disk::SaveDisk;
use std::ffi::OsString;
use std::fs::File;
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::path::{Path, PathBuf};

/// Names tried, of which the first is almost surely free.
const NAME_TRIES: usize = 10;

/// A name beside a file; it is taken away again unless another file has got it by then.
pub(super) struct Temporary<'a> {
    disk: &'a dyn SaveDisk,
    path: PathBuf,
    is_placed: bool,
}

impl<'a> Temporary<'a> {
    /// The first name that `make` finds free, and what it made there.
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

    /// A new file, locked, in the folder of the target: across file systems a rename is a copy,
    /// which may end half way.
    pub fn file(disk: &'a dyn SaveDisk, target: &Path) -> io::Result<(Self, File)> {
        Self::first_free(disk, target, "", |path| {
            let file = disk.create(path)?;
            // A file system without locks keeps its leftovers; nothing else depends on them.
            let is_locked = file.lock().is_ok();
            // Whoever sweeps may have come between the two.
            match is_locked && !path.exists() {
                true => Err(io::ErrorKind::AlreadyExists.into()),
                false => Ok(file),
            }
        })
    }

    /// A second name of a file. Nobody locks it: swept, it may be made anew by another process, but
    /// then for the same file, since no other temporaries are named so.
    pub fn second_name(disk: &'a dyn SaveDisk, file: &Path) -> io::Result<Self> {
        Ok(Self::first_free(disk, file, ".old", |path| disk.link(file, path))?.0)
    }

    /// Gives it its name for good, in place of whatever has it.
    pub fn place(mut self, path: &Path) -> io::Result<()> {
        self.disk.rename(&self.path, path)?;
        // Renaming onto another name of the same file does nothing and leaves both.
        self.is_placed = !self.path.exists();
        Ok(())
    }
}

impl Drop for Temporary<'_> {
    fn drop(&mut self) {
        if !self.is_placed {
            // One that stays costs space and nothing else, until it is swept.
            let _ = self.disk.remove(&self.path);
        }
    }
}

/// `.NAME.PROCESS.RANDOM.tmp`, or `.NAME.PROCESS.RANDOM.old.tmp`.
fn new_name(target: &Path, kind: &str) -> PathBuf {
    // The standard library's own source of randomness: another one in every process and at every call.
    let random = RandomState::new().build_hasher().finish();
    let mut name = OsString::from(".");
    name.push(target.file_name().unwrap_or_default());
    name.push(format!(".{}.{random:x}{kind}.tmp", std::process::id()));
    folder_of(target).join(name)
}

/// Removes what processes that were killed while they wrote `path` have left beside it: each is as
/// large as the file. What a process is writing at this moment stays.
pub fn remove_leftovers(path: &Path) {
    let Ok(Destination::File(file)) = Destination::of(path) else { return };
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

/// Whether a file is named as temporaries of `name` and its `.bak` are, or as earlier versions named
/// them.
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
        assert!(written.0.path.exists(), "somebody writes it");
        let second = Temporary::file(&SystemDisk, &path).unwrap();
        assert_ne!(second.0.path, written.0.path);
        drop((written, second));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), kept.len());
        remove_leftovers(&folder.path().join("none/a.vbgs"));
    }
}
