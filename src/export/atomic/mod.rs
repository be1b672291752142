//! Files appear whole or not at all (`export.md`, Atomic writing).
//!
//! Written beside the target, brought to the disk, then renamed over it: at every moment the name
//! stands for a whole file, the older or the newer one. Back-ups are second names of the older file
//! rather than copies, where the file system has them, and are made when the newer file is whole: a
//! save that fails changes nothing.

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

/// Bytes gathered before they are handed to the system.
const BUFFER_BYTES: usize = 1 << 16;
/// Back-ups tried while another process sweeps or saves in the same folder.
const BACK_UP_TRIES: usize = 5;

/// Writes `path` through `write` and returns the number of bytes.
///
/// The content goes to a temporary file in the same folder, reaches the disk, and then takes the
/// target's name in one step. On any error the temporary is deleted and an older file of that name
/// is untouched. The folder must exist: creating it is the caller's business.
///
/// An older file's permissions are those of the new one. A symbolic link stays one: the file that it
/// names is replaced, beside that file. Devices, FIFOs
/// and whatever else is no file cannot be replaced by one without harm (`/dev/null`), so they are
/// written to as they stand.
///
/// # Errors
/// [`Fault::NoFolder`], [`Fault::IsFolder`], [`Fault::DiskFull`], or [`Fault::Io`] with the error
/// of the system or of `write`.
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

/// Like [`write_atomic`]; an older file of that name stays as `<name>.bak`.
///
/// # Errors
/// As [`write_atomic`], or [`Fault::Io`] if the folder takes no second name or copy; the older file is
/// untouched then, and so is its `.bak`.
pub fn write_keeping_old(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    write_keeping_old_on(&SystemDisk, path, write)
}

/// [`write_keeping_old`] on a disk that may fail at any operation. At no moment is either name without
/// a complete file once it had one, and neither is ever opened for writing: they may be two names of
/// one file, and whoever writes to one would empty the other.
///
/// # Errors
/// As [`write_keeping_old`].
pub fn write_keeping_old_on(
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
    let written = match Destination::of(path) {
        Ok(Destination::File(file)) => replace(disk, &file, keeps_old, write),
        Ok(Destination::Stream) => write_through(path, write),
        Err(fault) => Err(fault),
    };
    written.map_err(|fault| fault.at(path))
}

/// Writes to what is there, without creating, emptying or replacing anything.
fn write_through(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    // Neither created nor emptied: the name may stand for something else since it was looked at.
    let stream = std::fs::OpenOptions::new()
        .write(true)
        .open(path)
        .map_err(|source| Fault::Io { action: "open this for writing", source })?;
    let mut out = Counted { inner: BufWriter::with_capacity(BUFFER_BYTES, stream), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    filled.map_err(failed("write", out.written))?;
    Ok(out.written)
}

/// Puts a complete file in the place of `path`, whose name is no link.
fn replace(
    disk: &dyn SaveDisk,
    path: &Path,
    keeps_old: bool,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    // `/` and what ends in `..` have no name of their own.
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
    filled.map_err(failed("write", written))?;
    let older = path.metadata().ok();
    if let Some(older) = &older {
        disk.resemble(&file, older)
            .map_err(failed("keep the older file's permissions", written))?;
    }
    // Before the rename: else a crash may leave the new name with content that never arrived.
    disk.sync(&file).map_err(failed("bring the data to the disk", written))?;
    if keeps_old && older.is_some() {
        back_up(disk, path)?;
    }
    temporary.place(path).map_err(failed("put the finished file in place", written))?;
    // Some file systems refuse to sync a folder; the file is complete and in place by then, so that
    // is no failure.
    let _ = disk.sync_folder(folder);
    Ok(written)
}

/// Keeps the file at `path` as `<name>.bak` too.
fn back_up(disk: &dyn SaveDisk, path: &Path) -> Result<(), Fault> {
    let kept = with_suffix(path, ".bak");
    for _ in 0..BACK_UP_TRIES {
        let Ok(second) = Temporary::second_name(disk, path) else {
            return copy_to(disk, path, &kept);
        };
        match second.place(&kept) {
            // Swept, between the two, by a process that begins in this folder.
            Err(e) if e.kind() == io::ErrorKind::NotFound => {}
            done => return done.map_err(|source| Fault::Io { action: KEEP_OLD, source }),
        }
    }
    copy_to(disk, path, &kept)
}

const KEEP_OLD: &str = "keep the older file as .bak";

/// A copy under the name `kept`, complete or not at all, for file systems without second names.
fn copy_to(disk: &dyn SaveDisk, file: &Path, kept: &Path) -> Result<(), Fault> {
    let mut old = File::open(file).map_err(|source| Fault::Io { action: KEEP_OLD, source })?;
    replace(disk, kept, false, |out| io::copy(&mut old, out).map(drop)).map(drop)
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

/// What to say of an error after `written` bytes.
pub(super) fn failed(action: &'static str, written: u64) -> impl Fn(io::Error) -> Fault {
    move |source| match source.kind() {
        _ if source.get_ref().is_some_and(|inner| inner.is::<Cancelled>()) => Fault::Cancelled,
        io::ErrorKind::StorageFull => Fault::DiskFull { written },
        _ => Fault::Io { action, source },
    }
}

/// A file written through the operations of a disk.
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
