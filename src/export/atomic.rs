//! Files appear whole or not at all (`export.md`, Atomic writing).

use super::error::{ExportError, Fault};
use std::ffi::OsString;
use std::io::{self, BufWriter, Write};
use std::path::Path;
use std::time::Duration;
use tempfile::NamedTempFile;

/// Renames tried while another program holds the target open, and the wait between two of them.
const RENAME_TRIES: usize = 5;
const RENAME_WAIT: Duration = Duration::from_millis(200);

/// Writes `path` through `write` and returns the number of bytes.
///
/// The content goes to a temporary file in the same folder, reaches the disk, and then takes the
/// target's name in one step. On any error the temporary is deleted and an older file of that name
/// is untouched. The folder must exist: creating it is the caller's business.
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
    write_inner(path, write).map_err(|fault| fault.at(path))
}

fn write_inner(
    path: &Path,
    write: impl FnOnce(&mut dyn Write) -> io::Result<()>,
) -> Result<u64, Fault> {
    let (Some(name), false) = (path.file_name(), path.is_dir()) else {
        return Err(Fault::IsFolder);
    };
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    if !folder.is_dir() {
        return Err(Fault::NoFolder { folder: folder.to_path_buf() });
    }
    let mut prefix = OsString::from(".");
    prefix.push(name);
    prefix.push(format!(".{}.", std::process::id()));
    let temporary = create_temporary(folder, &prefix)
        .map_err(|source| Fault::Io { action: "create a file in this folder", source })?;

    let mut out = Counted { inner: BufWriter::with_capacity(1 << 16, temporary), written: 0 };
    let filled = write(&mut out).and_then(|()| out.flush());
    let written = out.written;
    let failed = |action| {
        move |source: io::Error| match source.kind() {
            io::ErrorKind::StorageFull => Fault::DiskFull { written },
            _ => Fault::Io { action, source },
        }
    };
    filled.map_err(failed("write"))?;
    let temporary = out.inner.into_inner().map_err(|e| failed("write")(e.into_error()))?;
    temporary.as_file().sync_all().map_err(failed("bring the data to the disk"))?;
    rename(temporary, path).map_err(failed("put the finished file in place"))?;
    sync_folder(folder);
    Ok(written)
}

/// Keeps the file at `path`, if there is one, as `<name>.bak` too, so that writing `path` anew leaves
/// the older content. At no moment is either name without a complete file.
///
/// # Errors
/// [`Fault::Io`] if the folder takes no second name or copy; both files are as they were then.
pub fn back_up(path: &Path) -> Result<(), ExportError> {
    let Some(name) = path.file_name().filter(|_| path.is_file()) else { return Ok(()) };
    let beside = |suffix: &str| {
        let mut name = name.to_owned();
        name.push(suffix);
        path.with_file_name(name)
    };
    let second = beside(&format!(".{}.tmp", std::process::id()));
    // Some file systems have no links.
    let linked = std::fs::hard_link(path, &second)
        .or_else(|_| std::fs::copy(path, &second).map(drop))
        .and_then(|()| std::fs::rename(&second, beside(".bak")));
    linked.map_err(|source| {
        let _ = std::fs::remove_file(&second);
        Fault::Io { action: "keep the older file as .bak", source }.at(path)
    })
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
