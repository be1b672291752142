//! Atomic file replacement (`export.md`, Atomic writing).
//!
//! The content is written to a temporary file in the same folder, synced, then renamed over the target: the
//! name always refers to a complete file, old or new. A backup is a hard link to the older file (a copy where
//! the file system has no links). It is made once the new file is complete, so a failed save changes nothing.

mod destination;
mod disk;
mod temporary;

pub use disk::{SaveDisk, SystemDisk};
pub use temporary::remove_leftovers;

use super::error::{Cancelled, ExportError, Fault};
use destination::{Destination, folder_of};
use std::fs::File;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use temporary::Temporary;

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

/// Writes like [`write_keeping_old`], on any [`SaveDisk`].
///
/// Once either name has had a complete file, it always has one. Neither is ever opened for writing: both may
/// be links to one file, and truncating one would empty the other.
///
/// # Errors
/// As [`write_keeping_old`].
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
