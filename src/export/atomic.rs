//! Atomic file replacement (`files.md`, Atomic writing).
//!
//! The content is written to a temporary file in the same folder, synced, then renamed over the target: the
//! name always refers to a complete file, old or new. A backup is a hard link to the older file (a copy where
//! the file system has no links). It is made once the new file is complete, so a failed save changes nothing.
//! Neither name is ever opened for writing: both may be links to one file, and truncating one would empty the
//! other.

use super::error::{Cancelled, ExportError, Fault};
use std::ffi::OsString;
use std::fs::{File, Metadata, OpenOptions};
use std::io;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::{Builder, NamedTempFile};

const BUFFER_BYTES: usize = 1 << 16;
// Another process that cleans up or saves in the same folder may remove the link in between.
const BACK_UP_TRIES: usize = 5;
// Less than a second in all: viewers and virus scanners hold a file open only for a moment.
const RENAME_TRIES: usize = 5;
const RENAME_WAIT: Duration = Duration::from_millis(200);

/// Disk operations of a save.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SaveStep {
    /// Creates the temporary file.
    Create,
    /// Writes some bytes.
    Write,
    /// Copies the permissions of the older file.
    Permissions,
    /// Flushes the written data to the storage device.
    Sync,
    /// Makes a hard link to the older file.
    Link,
    /// Renames the temporary file or hard link.
    Rename,
    /// Flushes the entries of the folder to the storage device.
    SyncFolder,
    /// Removes the temporary file or hard link.
    Remove,
}

/// Callback before each operation of a save. The operation is not executed if it returns an error.
pub type SaveCheck<'a> = &'a dyn Fn(SaveStep) -> io::Result<()>;

/// Writes a file through `write` and returns its number of bytes.
///
/// The content goes to a temporary file in the same folder, is synced, and then renamed over the target. On
/// any error the temporary file is deleted and an existing target is untouched. The folder must exist.
///
/// The new file gets the permissions of the one it replaces. A symbolic link is preserved: the file it points
/// to is replaced. Devices, FIFOs and sockets (such as `/dev/null`) are written to directly, since replacing
/// them would destroy them.
///
/// # Errors
/// [`Fault::NoFolder`], [`Fault::IsFolder`], [`Fault::DiskFull`], or [`Fault::Io`] with the error of the
/// system or of `write`.
///
/// ```
/// use std::io::{Error, Write};
/// use vbgs_studio::export::atomic::write_atomic;
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("notes.txt");
/// assert_eq!(write_atomic(&path, |out| out.write_all(b"whole"))?, 5);
/// assert!(write_atomic(&path, |_| Err(Error::other("interrupted"))).is_err());
/// assert_eq!(std::fs::read(&path)?, b"whole");
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn write_atomic(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    write_checked(&|_| Ok(()), path, false, write)
}

/// Writes like [`write_atomic`] and retains an existing target as `<name>.bak`.
///
/// # Errors
/// As [`write_atomic`], or [`Fault::Io`] if neither a hard link nor a copy can be made. The older file and
/// its `.bak` are then untouched.
pub fn write_with_backup(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    write_checked(&|_| Ok(()), path, true, write)
}

/// Writes like [`write_with_backup`] if `keeps_old`, otherwise like [`write_atomic`]. Calls `check`
/// before each disk operation, so that tests can let single operations fail.
///
/// # Errors
/// As [`write_with_backup`].
pub fn write_checked(
    check: SaveCheck,
    path: &Path,
    keeps_old: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    let written = match Destination::resolve(path) {
        Ok(Destination::File(file)) => replace(check, &file, keeps_old, write),
        Ok(Destination::Stream) => write_through(path, write),
        Err(fault) => Err(fault),
    };
    written.map_err(|fault| fault.with_path(path))
}

fn write_through(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    // No create and no truncate: the name may have become a regular file since the check.
    let stream = std::fs::OpenOptions::new()
        .write(true)
        .open(path)
        .map_err(|source| Fault::Io { action: "open this for writing", source })?;
    fill(&|_| Ok(()), &stream, write)
}

fn fill(
    check: SaveCheck,
    file: &File,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    let mut out = Content { check, file: BufWriter::with_capacity(BUFFER_BYTES, file), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    filled.map_err(to_fault("write", out.written))?;
    Ok(out.written)
}

/// Replaces the file at `path` by a complete one and returns its number of bytes. `path` must not be a
/// symbolic link.
fn replace(
    check: SaveCheck,
    path: &Path,
    keeps_old: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    // `/` and paths that end in `..` have no file name.
    if path.file_name().is_none() {
        return Err(Fault::IsFolder);
    }
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Fault::NoFolder { folder: folder.to_path_buf() });
    }
    let temporary = Temporary::file(check, path)
        .map_err(|source| Fault::Io { action: "create a file in this folder", source })?;
    let file = temporary.entry.as_file();
    let written = fill(check, file, write)?;
    let older = path.metadata().ok();
    if let Some(older) = &older {
        check(SaveStep::Permissions)
            .and_then(|()| copy_permissions(file, older))
            .map_err(to_fault("keep the older file's permissions", written))?;
    }
    // Synced before the rename: otherwise a crash may leave the new name with missing content.
    check(SaveStep::Sync)
        .and_then(|()| file.sync_all())
        .map_err(to_fault("flush the data to the disk", written))?;
    if keeps_old && older.is_some() {
        back_up(check, path)?;
    }
    temporary.rename_to(path).map_err(to_fault("put the finished file in place", written))?;
    // Some file systems cannot sync a folder. The file is complete and in place, so this is not an
    // error.
    if cfg!(unix) && check(SaveStep::SyncFolder).is_ok() {
        let _ = File::open(folder).and_then(|folder| folder.sync_all());
    }
    Ok(written)
}

fn copy_permissions(file: &File, older: &Metadata) -> io::Result<()> {
    #[cfg(unix)]
    {
        use std::os::unix::fs::MetadataExt;
        // Changed before the permissions, because a change of owner clears some of them. Only root may
        // change the owner; for other users it stays the writer.
        let _ = std::os::unix::fs::fchown(file, Some(older.uid()), Some(older.gid()));
        file.set_permissions(older.permissions())
    }
    #[cfg(not(unix))]
    {
        // On this platform permissions come from the folder, and "read-only" would block the rename.
        let _ = (file, older);
        Ok(())
    }
}

fn back_up(check: SaveCheck, path: &Path) -> Result<(), Fault> {
    const ACTION: &str = "keep the older file as .bak";
    let failed = |source| Fault::Io { action: ACTION, source };
    let kept = with_suffix(path, ".bak");
    for _ in 0..BACK_UP_TRIES {
        let Ok(second) = Temporary::hard_link(check, path) else { break };
        match second.rename_to(&kept) {
            // Another process that starts in this folder removed the link between the two calls.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            done => return done.map_err(failed),
        }
    }
    // Without hard links, a copy, atomically.
    let mut old = File::open(path).map_err(failed)?;
    replace(check, &kept, false, |out| io::copy(&mut old, out).map(drop)).map(drop)
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

pub(super) fn to_fault(action: &'static str, written: u64) -> impl Fn(io::Error) -> Fault {
    move |source| match source.kind() {
        _ if source.get_ref().is_some_and(|inner| inner.is::<Cancelled>()) => Fault::Cancelled,
        io::ErrorKind::StorageFull => Fault::DiskFull { written },
        _ => Fault::Io { action, source },
    }
}

struct Content<'a> {
    check: SaveCheck<'a>,
    file: BufWriter<&'a File>,
    written: u64,
}

impl Write for Content<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        (self.check)(SaveStep::Write)?;
        let n = self.file.write(bytes)?;
        self.written += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

/// Maximum number of symbolic links that are followed; a longer chain counts as a cycle.
// The limit of Linux.
const MAX_LINKS: usize = 40;

enum Destination {
    /// Existing or future regular file, with all links resolved.
    File(PathBuf),
    /// Device, FIFO or socket.
    Stream,
}

impl Destination {
    pub fn resolve(path: &Path) -> Result<Self, Fault> {
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => Err(Fault::IsFolder),
            Ok(found) if !found.is_file() => Ok(Self::Stream),
            Ok(_) if path.is_symlink() => match path.canonicalize() {
                Ok(file) => Ok(Self::File(file)),
                Err(source) => Err(Fault::Io { action: "follow this link", source }),
            },
            Err(e) if path.is_symlink() => end_of_links(path, e).map(Self::File),
            // Any other problem with the path is reported when it is used.
            Ok(_) | Err(_) => Ok(Self::File(path.to_path_buf())),
        }
    }
}

/// Follows the symbolic links of a path whose target does not exist yet. Returns the path of the target,
/// or the error `missing` if the links form a cycle.
fn end_of_links(path: &Path, missing: io::Error) -> Result<PathBuf, Fault> {
    // `canonicalize` fails for a missing file.
    let mut end = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&end) {
            Ok(next) => end = end.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(end),
        }
    }
    Err(Fault::Io { action: "follow this link", source: missing })
}

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        // A bare name has an empty parent, which is not a valid path.
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

struct Temporary<'a, T> {
    check: SaveCheck<'a>,
    entry: NamedTempFile<T>,
}

impl<'a, T> Temporary<'a, T> {
    /// Creates `.NAME.PROCESS.RANDOM<suffix>` in the target's folder by calling `make` with its path.
    fn create(
        check: SaveCheck<'a>,
        target: &Path,
        suffix: &str,
        make: impl FnMut(&Path) -> io::Result<T>,
    ) -> io::Result<Self> {
        let mut prefix = OsString::from(".");
        prefix.push(target.file_name().unwrap_or_default());
        prefix.push(format!(".{}.", std::process::id()));
        // Not in another folder: across file systems a rename is a copy, which can be interrupted.
        let entry =
            Builder::new().prefix(&prefix).suffix(suffix).make_in(folder_of(target), make)?;
        Ok(Self { check, entry })
    }

    fn rename_to(self, path: &Path) -> io::Result<()> {
        // Not `persist`: renaming onto another link to the same file does nothing and leaves both names, of
        // which the drop removes this one.
        for _ in 1..RENAME_TRIES {
            (self.check)(SaveStep::Rename)?;
            match std::fs::rename(self.entry.path(), path) {
                // A viewer or virus scanner often holds the target open for a moment.
                Err(e) if cfg!(windows) && e.kind() == io::ErrorKind::PermissionDenied => {
                    std::thread::sleep(RENAME_WAIT);
                }
                done => return done,
            }
        }
        std::fs::rename(self.entry.path(), path)
    }
}

impl<'a> Temporary<'a, File> {
    fn file(check: SaveCheck<'a>, target: &Path) -> io::Result<Self> {
        Self::create(check, target, ".tmp", |path| {
            check(SaveStep::Create)?;
            let file = OpenOptions::new().write(true).create_new(true).open(path)?;
            // On a file system without locks, leftovers are not removed; nothing else depends on the lock.
            let is_locked = file.lock().is_ok();
            // Another process may have removed the file between creation and lock.
            match is_locked && matches!(path.try_exists(), Ok(false)) {
                // On this error `tempfile` tries another name.
                true => Err(io::ErrorKind::AlreadyExists.into()),
                false => Ok(file),
            }
        })
    }
}

impl<'a> Temporary<'a, ()> {
    fn hard_link(check: SaveCheck<'a>, file: &Path) -> io::Result<Self> {
        // Without a lock: if another process removes the link and creates it again, it still refers to the
        // same file, since only such links have this kind of name.
        Self::create(check, file, ".old.tmp", |path| {
            check(SaveStep::Link)?;
            std::fs::hard_link(file, path)
        })
    }
}

impl<T> Drop for Temporary<'_, T> {
    fn drop(&mut self) {
        // A leftover only takes space until the next cleanup.
        let is_kept = (self.check)(SaveStep::Remove).is_err();
        self.entry.disable_cleanup(is_kept);
    }
}

/// Removes temporary files that interrupted saves to `path` left behind. Keeps the files of saves in
/// progress.
pub fn remove_leftovers(path: &Path) {
    let Ok(Destination::File(file)) = Destination::resolve(path) else { return };
    let Some(name) = file.file_name().and_then(|name| name.to_str()) else { return };
    let Ok(entries) = std::fs::read_dir(folder_of(&file)) else { return };
    for entry in entries.flatten() {
        let is_file = entry.file_type().is_ok_and(|kind| kind.is_file());
        if is_file && entry.file_name().to_str().is_some_and(|found| is_temporary(found, name)) {
            let Ok(left) = File::open(entry.path()) else { continue };
            // A writer holds the lock until it is done; the system releases that of a killed one.
            if left.try_lock().is_ok() {
                let _ = std::fs::remove_file(entry.path());
            }
        }
    }
}

fn is_temporary(found: &str, name: &str) -> bool {
    let rest = found.strip_prefix('.').and_then(|found| found.strip_prefix(name));
    let rest = rest.map(|rest| rest.strip_prefix(".bak").unwrap_or(rest));
    let middle = rest.and_then(|rest| rest.strip_prefix('.')?.strip_suffix(".tmp"));
    let process = middle.and_then(|middle| middle.split('.').next()?.parse::<u32>().ok());
    process.is_some()
}

#[cfg(test)]
mod temporary_tests {
    use super::*;

    #[test]
    fn only_what_nobody_writes_any_more_of_this_file_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vbgs");
        let left = [".a.vbgs.0.Ab3.tmp", ".a.vbgs.7.0.old.tmp", ".a.vbgs.bak.7.1.tmp"];
        let kept = ["a.vbgs", "a.vbgs.bak", "a.vbgs.notes.tmp", ".b.vbgs.0.Ab3.tmp"];
        left.iter().chain(&kept).for_each(|name| {
            std::fs::write(folder.path().join(name), "x").unwrap();
        });
        let written = Temporary::file(&|_| Ok(()), &path).unwrap();
        remove_leftovers(&path);
        assert!(left.iter().all(|name| !folder.path().join(name).exists()));
        assert!(kept.iter().all(|name| folder.path().join(name).exists()));
        assert!(written.entry.path().exists(), "still being written");
        let second = Temporary::file(&|_| Ok(()), &path).unwrap();
        assert_ne!(second.entry.path(), written.entry.path());
        drop((written, second));
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), kept.len());
        remove_leftovers(&folder.path().join("none/a.vbgs"));
    }
}
