//! Atomic file replacement (`files.md`, Atomic writing).
//!
//! The content is written to a temporary file in the same folder, synced, then renamed over the target: the
//! name always refers to a complete file, old or new. A backup is a hard link to the older file (a copy where
//! the file system has no links). It is made once the new file is complete, so a failed save changes nothing.

use super::error::{Cancelled, ExportError, Fault};
use std::ffi::OsString;
use std::fs::{File, Metadata, OpenOptions};
use std::hash::{BuildHasher, Hasher, RandomState};
use std::io;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

const BUFFER_BYTES: usize = 1 << 16;
/// Attempts to make a backup while another process cleans up or saves in the same folder.
const BACK_UP_TRIES: usize = 5;

/// Writes `path` through `write` and returns the number of bytes.
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
    write_on(&SystemDisk, path, false, write)
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
    write_with_backup_on(&SystemDisk, path, write)
}

/// Writes like [`write_with_backup`], on any [`SaveDisk`].
///
/// Once either name has had a complete file, it always has one. Neither is ever opened for writing: both may
/// be links to one file, and truncating one would empty the other.
///
/// # Errors
/// As [`write_with_backup`].
pub fn write_with_backup_on(
    disk: &dyn SaveDisk,
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    write_on(disk, path, true, write)
}

fn write_on(
    disk: &dyn SaveDisk,
    path: &Path,
    keeps_old: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    let written = match Destination::resolve(path) {
        Ok(Destination::File(file)) => replace(disk, &file, keeps_old, write),
        Ok(Destination::Stream) => write_through(path, write),
        Err(fault) => Err(fault),
    };
    written.map_err(|fault| fault.with_path(path))
}

/// Writes to an existing stream without creating, truncating or replacing anything.
fn write_through(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    // No create and no truncate: the name may have become a regular file since the check.
    let stream = std::fs::OpenOptions::new()
        .write(true)
        .open(path)
        .map_err(|source| Fault::Io { action: "open this for writing", source })?;
    let mut out = Counted { inner: BufWriter::with_capacity(BUFFER_BYTES, stream), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    filled.map_err(to_fault("write", out.written))?;
    Ok(out.written)
}

/// Replaces `path`, which is no symbolic link, by a complete file.
fn replace(
    disk: &dyn SaveDisk,
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
    let (temporary, file) = Temporary::file(disk, path)
        .map_err(|source| Fault::Io { action: "create a file in this folder", source })?;
    let sink = DiskFile { disk, file: &file };
    let mut out = Counted { inner: BufWriter::with_capacity(BUFFER_BYTES, sink), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    let written = out.written;
    filled.map_err(to_fault("write", written))?;
    let older = path.metadata().ok();
    if let Some(older) = &older {
        disk.copy_permissions(&file, older)
            .map_err(to_fault("keep the older file's permissions", written))?;
    }
    // Before the rename: otherwise a crash may leave the new name with missing content.
    disk.sync(&file).map_err(to_fault("flush the data to the disk", written))?;
    if keeps_old && older.is_some() {
        back_up(disk, path)?;
    }
    temporary.rename_to(path).map_err(to_fault("put the finished file in place", written))?;
    // Some file systems cannot sync a folder. The file is complete and in place, so this is no error.
    let _ = disk.sync_folder(folder);
    Ok(written)
}

/// Links the file at `path` as `<name>.bak` too.
fn back_up(disk: &dyn SaveDisk, path: &Path) -> Result<(), Fault> {
    let kept = with_suffix(path, ".bak");
    for _ in 0..BACK_UP_TRIES {
        let Ok(second) = Temporary::hard_link(disk, path) else {
            return copy_to(disk, path, &kept);
        };
        match second.rename_to(&kept) {
            // Another process that starts in this folder removed the link between the two calls.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            done => return done.map_err(|source| Fault::Io { action: BACK_UP_ACTION, source }),
        }
    }
    copy_to(disk, path, &kept)
}

const BACK_UP_ACTION: &str = "keep the older file as .bak";

/// Copies `file` to `kept` atomically, for file systems without hard links.
fn copy_to(disk: &dyn SaveDisk, file: &Path, kept: &Path) -> Result<(), Fault> {
    let mut old =
        File::open(file).map_err(|source| Fault::Io { action: BACK_UP_ACTION, source })?;
    replace(disk, kept, false, |out| io::copy(&mut old, out).map(drop)).map(drop)
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// Converts an I/O error after `written` bytes.
pub(super) fn to_fault(action: &'static str, written: u64) -> impl Fn(io::Error) -> Fault {
    move |source| match source.kind() {
        _ if source.get_ref().is_some_and(|inner| inner.is::<Cancelled>()) => Fault::Cancelled,
        io::ErrorKind::StorageFull => Fault::DiskFull { written },
        _ => Fault::Io { action, source },
    }
}

struct DiskFile<'a> {
    disk: &'a dyn SaveDisk,
    file: &'a File,
}

impl Write for DiskFile<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.disk.write(self.file, bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

struct Counted<W> {
    inner: W,
    written: u64,
}

impl<W: Write> Write for Counted<W> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        let n = self.inner.write(bytes)?;
        self.written += n as u64;
        Ok(n)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.inner.flush()
    }
}

/// Maximum number of links followed before a cycle is assumed; Linux uses the same limit.
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

/// Resolves a symbolic link whose target file does not exist.
fn end_of_links(path: &Path, missing: io::Error) -> Result<PathBuf, Fault> {
    let mut end = path.to_path_buf();
    for _ in 0..MAX_LINKS {
        match std::fs::read_link(&end) {
            Ok(next) => end = end.parent().unwrap_or(Path::new("")).join(next),
            Err(_) => return Ok(end),
        }
    }
    Err(Fault::Io { action: "follow this link", source: missing })
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Attempts to rename while another program holds the target open, and the delay between them.
const RENAME_TRIES: usize = 5;
const RENAME_WAIT: Duration = Duration::from_millis(200);

/// File-system operations of a save. An operation that returns an error had no effect.
pub trait SaveDisk {
    /// Creates an empty file, open for writing.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if the name is taken.
    fn create(&self, path: &Path) -> io::Result<File>;
    /// Copies the permissions and, if allowed, the owner of the file that will be replaced.
    ///
    /// # Errors
    /// The permissions could not be set.
    fn copy_permissions(&self, file: &File, older: &Metadata) -> io::Result<()>;
    /// Appends a prefix of `bytes` and returns its length.
    ///
    /// # Errors
    /// Nothing was written.
    fn write(&self, file: &File, bytes: &[u8]) -> io::Result<usize>;
    /// Flushes written data to the storage device.
    ///
    /// # Errors
    /// Written data may be lost.
    fn sync(&self, file: &File) -> io::Result<()>;
    /// Creates a hard link `second` to `file`; the name must be free.
    ///
    /// # Errors
    /// Also if the file system has no hard links.
    fn link(&self, file: &Path, second: &Path) -> io::Result<()>;
    /// Renames a file, replacing any file at `to`.
    ///
    /// # Errors
    /// Both names are unchanged.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Removes a name.
    ///
    /// # Errors
    /// The name still exists, or never did.
    fn remove(&self, path: &Path) -> io::Result<()>;
    /// Flushes the entries of a folder to the storage device.
    ///
    /// # Errors
    /// Also if the file system does not support it.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;
}

/// The operating system's file system.
#[derive(Clone, Copy, Debug)]
pub struct SystemDisk;

impl SaveDisk for SystemDisk {
    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create_new(true).open(path)
    }

    fn copy_permissions(&self, file: &File, older: &Metadata) -> io::Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            // Before the permissions: a change of owner clears some of them. Only root may change the owner;
            // for other users it stays the writer.
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

    fn write(&self, mut file: &File, bytes: &[u8]) -> io::Result<usize> {
        io::Write::write(&mut file, bytes)
    }

    fn sync(&self, file: &File) -> io::Result<()> {
        file.sync_all()
    }

    fn link(&self, file: &Path, second: &Path) -> io::Result<()> {
        std::fs::hard_link(file, second)
    }

    fn rename(&self, from: &Path, to: &Path) -> io::Result<()> {
        for _ in 1..RENAME_TRIES {
            match std::fs::rename(from, to) {
                // A viewer or virus scanner often holds the target open for a moment.
                Err(e) if cfg!(windows) && e.kind() == io::ErrorKind::PermissionDenied => {
                    std::thread::sleep(RENAME_WAIT);
                }
                done => return done,
            }
        }
        std::fs::rename(from, to)
    }

    fn remove(&self, path: &Path) -> io::Result<()> {
        std::fs::remove_file(path)
    }

    fn sync_folder(&self, folder: &Path) -> io::Result<()> {
        match cfg!(unix) {
            true => File::open(folder).and_then(|folder| folder.sync_all()),
            false => Ok(()),
        }
    }
}

/// Number of names tried; the first is almost certainly free.
const NAME_TRIES: usize = 10;

/// Temporary name beside a file, removed on drop unless it was moved into place.
struct Temporary<'a> {
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
mod temporary_tests {
    use super::*;
    use crate::export::atomic::SystemDisk;

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
