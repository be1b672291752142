//! Files appear whole or not at all (`export.md`, Atomic writing).
//!
//! Written beside the target, brought to the disk, then renamed over it: at every moment the name
//! stands for a whole file, the older or the newer one. Back-ups are second names of the older file
//! rather than copies, where the file system has them.

use super::error::{Cancelled, ExportError, Fault};
use std::ffi::OsString;
use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;
use tempfile::NamedTempFile;

/// Renames tried while another program holds the target open, and the wait between two of them.
const RENAME_TRIES: usize = 5;
const RENAME_WAIT: Duration = Duration::from_millis(200);
/// Bytes gathered before they are handed to the system.
const BUFFER_BYTES: usize = 1 << 16;

/// Links followed from one name to the next before they count as a circle, as Linux counts.
const MAX_LINKS: usize = 40;

/// Writes `path` through `write` and returns the number of bytes.
///
/// The content goes to a temporary file in the same folder, reaches the disk, and then takes the
/// target's name in one step. On any error the temporary is deleted and an older file of that name
/// is untouched. The folder must exist: creating it is the caller's business.
///
/// A symbolic link stays one: the file that it names is replaced, beside that file. Devices, FIFOs
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
    let written = match Destination::of(path) {
        Ok(Destination::File(file)) => replace(&file, write),
        Ok(Destination::Stream) => write_through(path, write),
        Err(fault) => Err(fault),
    };
    written.map_err(|fault| fault.at(path))
}

/// Like [`write_atomic`]; an older file of that name stays as `<name>.bak`.
///
/// # Errors
/// As [`write_atomic`]; the older file is untouched then, and so is its copy.
pub fn write_keeping_old(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, ExportError> {
    back_up(path)?;
    write_atomic(path, write)
}

/// What a name stands for.
enum Destination {
    /// A file that is there or will be, at the end of all links.
    File(PathBuf),
    /// A device, a FIFO, a socket.
    Stream,
}

impl Destination {
    fn of(path: &Path) -> Result<Self, Fault> {
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => Err(Fault::IsFolder),
            Ok(found) if !found.is_file() => Ok(Self::Stream),
            Ok(_) if path.is_symlink() => match path.canonicalize() {
                Ok(file) => Ok(Self::File(file)),
                Err(source) => Err(Fault::Io { action: "follow this link", source }),
            },
            Err(e) if path.is_symlink() => end_of_links(path, e).map(Self::File),
            // Whatever else is wrong with the name is said where it is used.
            Ok(_) | Err(_) => Ok(Self::File(path.to_path_buf())),
        }
    }
}

/// The name that a link whose file is missing leads to.
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

fn replace(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    let (temporary, written) = fill_temporary(path, write)?;
    rename(temporary, path).map_err(failed("put the finished file in place", written))?;
    sync_folder(folder_of(path));
    Ok(written)
}

/// A complete file on the disk in the folder of `path`, under a name of its own, and its length.
fn fill_temporary(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<(NamedTempFile, u64), Fault> {
    // `/` and what ends in `..` have no name of their own.
    let Some(name) = path.file_name() else { return Err(Fault::IsFolder) };
    let folder = folder_of(path);
    if !folder.is_dir() {
        return Err(Fault::NoFolder { folder: folder.to_path_buf() });
    }
    let mut prefix = OsString::from(".");
    prefix.push(name);
    prefix.push(format!(".{}.", std::process::id()));
    // In the target's own folder: across file systems a rename is a copy, which may end half way.
    let temporary = create_temporary(folder, &prefix)
        .map_err(|source| Fault::Io { action: "create a file in this folder", source })?;

    let mut out = Counted { inner: BufWriter::with_capacity(BUFFER_BYTES, temporary), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    let written = out.written;
    filled.map_err(failed("write", written))?;
    let temporary = out.inner.into_inner().map_err(|e| failed("write", written)(e.into_error()))?;
    // Before the rename: else a crash may leave the new name with content that never arrived.
    temporary.as_file().sync_all().map_err(failed("bring the data to the disk", written))?;
    Ok((temporary, written))
}

/// What to say of an error after `written` bytes.
fn failed(action: &'static str, written: u64) -> impl Fn(io::Error) -> Fault {
    move |source| match source.kind() {
        _ if source.get_ref().is_some_and(|inner| inner.is::<Cancelled>()) => Fault::Cancelled,
        io::ErrorKind::StorageFull => Fault::DiskFull { written },
        _ => Fault::Io { action, source },
    }
}

fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}

/// Keeps the file at `path`, if there is one, as `<name>.bak` too, so that writing `path` anew leaves
/// the older content. At no moment is either name without a complete file, and neither file is ever
/// opened for writing: after a save that failed, both names are one file, and whoever writes to one
/// empties the other. A link is followed first; the `.bak` lies beside the file it names.
///
/// # Errors
/// [`Fault::Io`] or [`Fault::DiskFull`] if the folder takes no second name or copy; both files are as
/// they were then.
pub fn back_up(path: &Path) -> Result<(), ExportError> {
    back_up_by(path, |file, second| std::fs::hard_link(file, second))
}

/// [`back_up`] by a way to give a file a second name, which some file systems do not have.
fn back_up_by(
    path: &Path,
    link: impl FnOnce(&Path, &Path) -> io::Result<()>,
) -> Result<(), ExportError> {
    let file = match Destination::of(path) {
        Ok(Destination::File(file)) if file.is_file() => file,
        _ => return Ok(()),
    };
    let kept = with_suffix(&file, ".bak");
    let second = with_suffix(&file, &format!(".{}.tmp", std::process::id()));
    // What a process of this number left behind here; its name only, the file may be the target.
    let _ = std::fs::remove_file(&second);
    let done = match link(&file, &second) {
        Ok(()) => {
            let renamed = std::fs::rename(&second, &kept);
            // Renaming onto another name of the same file does nothing and leaves both.
            let _ = std::fs::remove_file(&second);
            renamed.map_err(|source| Fault::Io { action: KEEP_OLD, source })
        }
        Err(_) => copy_to(&file, &kept),
    };
    done.map_err(|fault| fault.at(path))
}

/// Removes what processes that were killed while they wrote `path` have left beside it: each is as
/// large as the file. Not for files that another process may be writing at this moment.
pub fn remove_leftovers(path: &Path) {
    let Ok(Destination::File(file)) = Destination::of(path) else { return };
    let Some(name) = file.file_name().and_then(|name| name.to_str()) else { return };
    let Ok(entries) = std::fs::read_dir(folder_of(&file)) else { return };
    for entry in entries.flatten() {
        if entry.file_name().to_str().is_some_and(|found| is_leftover(found, name)) {
            // One that stays costs space and nothing else.
            let _ = std::fs::remove_file(entry.path());
        }
    }
}

/// Whether a file is named as temporaries and second names of `name` are, by another process.
fn is_leftover(found: &str, name: &str) -> bool {
    let rest = found.strip_prefix('.').unwrap_or(found).strip_prefix(name);
    let middle = rest.and_then(|rest| rest.strip_prefix('.')?.strip_suffix(".tmp"));
    let process = middle.and_then(|middle| middle.split('.').next()?.parse::<u32>().ok());
    process.is_some_and(|process| process != std::process::id())
}

const KEEP_OLD: &str = "keep the older file as .bak";

/// A copy under the name `kept`, complete or not at all.
fn copy_to(file: &Path, kept: &Path) -> Result<(), Fault> {
    let mut old =
        std::fs::File::open(file).map_err(|source| Fault::Io { action: KEEP_OLD, source })?;
    replace(kept, |out| io::copy(&mut old, out).map(drop)).map(drop)
}

fn with_suffix(path: &Path, suffix: &str) -> PathBuf {
    let mut name = path.as_os_str().to_owned();
    name.push(suffix);
    PathBuf::from(name)
}

fn create_temporary(folder: &Path, prefix: &OsString) -> io::Result<NamedTempFile> {
    let mut builder = tempfile::Builder::new();
    builder.prefix(prefix).suffix(".tmp");
    // Temporary files are private by default, an export is an ordinary file: let the umask decide.
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        builder.permissions(std::fs::Permissions::from_mode(0o666));
    }
    builder.tempfile_in(folder)
}

fn rename(mut temporary: NamedTempFile, path: &Path) -> io::Result<()> {
    let mut tries = 1;
    loop {
        match temporary.persist(path) {
            Ok(_) => return Ok(()),
            Err(e)
                if cfg!(windows)
                    && tries < RENAME_TRIES
                    && e.error.kind() == io::ErrorKind::PermissionDenied =>
            {
                // A viewer or a virus scanner often holds the target for a moment.
                std::thread::sleep(RENAME_WAIT);
                temporary = e.file;
                tries += 1;
            }
            Err(e) => return Err(e.error),
        }
    }
}

/// Makes the new name itself durable. Some file systems refuse to sync a folder; the file is
/// complete and in place by then, so that is no failure.
fn sync_folder(folder: &Path) {
    if cfg!(unix) {
        let _ = std::fs::File::open(folder).and_then(|f| f.sync_all());
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_other_processes_left_of_this_file_is_removed() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vbgs");
        let own = format!(".a.vbgs.{}.x1.tmp", std::process::id());
        let left = [".a.vbgs.0.Ab3.tmp", "a.vbgs.0.tmp"];
        let kept = ["a.vbgs", "a.vbgs.bak", "a.vbgs.notes.tmp", ".b.vbgs.0.Ab3.tmp", own.as_str()];
        left.iter().chain(&kept).for_each(|name| {
            std::fs::write(folder.path().join(name), "x").unwrap();
        });
        remove_leftovers(&path);
        assert!(left.iter().all(|name| !folder.path().join(name).exists()));
        assert!(kept.iter().all(|name| folder.path().join(name).exists()));
        remove_leftovers(&folder.path().join("none/a.vbgs"));
    }

    /// On a file system without links the copy never touches what is there, not even when the two
    /// names are already one file.
    #[test]
    fn the_copy_where_there_are_no_links_is_a_file_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let (path, kept) = (folder.path().join("a.vbgs"), folder.path().join("a.vbgs.bak"));
        std::fs::write(&path, "old").unwrap();
        std::fs::hard_link(&path, &kept).unwrap();
        // What an interrupted back-up of this process would leave: a third name of the same file.
        std::fs::hard_link(&path, with_suffix(&path, &format!(".{}.tmp", std::process::id())))
            .unwrap();
        for _ in 0..2 {
            back_up_by(&path, |_, _| Err(io::ErrorKind::Unsupported.into())).unwrap();
            assert_eq!(std::fs::read_to_string(&path).unwrap(), "old");
            assert_eq!(std::fs::read_to_string(&kept).unwrap(), "old");
            assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 2);
        }
        std::fs::write(&path, "new").unwrap();
        assert_eq!(std::fs::read_to_string(&kept).unwrap(), "old", "two files");
    }
}
