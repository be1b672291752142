//! File-system operations of a save, behind a trait.
//!
//! Every change to a folder during a save goes through [`SaveDisk`]. Tests can therefore fail each operation,
//! or end the process there, one after another.

use std::fs::{File, Metadata, OpenOptions};
use std::io;
use std::path::Path;
use std::time::Duration;

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
