//! What a save asks of the file system, one operation at a time.
//!
//! Everything that changes a folder while a file is written goes through [`SaveDisk`], so that tests
//! can let each operation fail, or let the process end there, one after the other: moments that
//! sampling by chance would hardly ever meet.

use std::fs::{File, Metadata, OpenOptions};
use std::io;
use std::path::Path;
use std::time::Duration;

/// Renames tried while another program holds the target open, and the wait between two of them.
const RENAME_TRIES: usize = 5;
const RENAME_WAIT: Duration = Duration::from_millis(200);

/// The operations that a save is made of. Each either happens or, by its error, does not.
pub trait SaveDisk {
    /// Creates an empty file, open for writing.
    ///
    /// # Errors
    /// [`io::ErrorKind::AlreadyExists`] if there is anything of that name.
    fn create(&self, path: &Path) -> io::Result<File>;
    /// Gives a new file the permissions, and as far as it may the owner, of one that it will replace.
    ///
    /// # Errors
    /// Permissions that could not be set.
    fn resemble(&self, file: &File, older: &Metadata) -> io::Result<()>;
    /// Appends the first of these bytes, how many it says, as a file takes them.
    ///
    /// # Errors
    /// Nothing was written.
    fn write(&self, file: &File, bytes: &[u8]) -> io::Result<usize>;
    /// Brings what was written to the disk.
    ///
    /// # Errors
    /// What was written may be lost.
    fn sync(&self, file: &File) -> io::Result<()>;
    /// Gives a file a second name, at which there is nothing.
    ///
    /// # Errors
    /// Among others that this file system has no second names.
    fn link(&self, file: &Path, second: &Path) -> io::Result<()>;
    /// Gives a file another name, in place of whatever has it.
    ///
    /// # Errors
    /// Both names are as they were.
    fn rename(&self, from: &Path, to: &Path) -> io::Result<()>;
    /// Takes a name away.
    ///
    /// # Errors
    /// The name is still there, or never was.
    fn remove(&self, path: &Path) -> io::Result<()>;
    /// Makes the names in a folder durable.
    ///
    /// # Errors
    /// Among others that this file system cannot.
    fn sync_folder(&self, folder: &Path) -> io::Result<()>;
}

/// The file system of the machine.
#[derive(Clone, Copy, Debug)]
pub struct SystemDisk;

impl SaveDisk for SystemDisk {
    fn create(&self, path: &Path) -> io::Result<File> {
        OpenOptions::new().write(true).create_new(true).open(path)
    }

    fn resemble(&self, file: &File, older: &Metadata) -> io::Result<()> {
        #[cfg(unix)]
        {
            use std::os::unix::fs::MetadataExt;
            // Before the permissions, of which a change of owner takes some away. Only root gives
            // files to others, and whoever may not leaves them with the one who writes.
            let _ = std::os::unix::fs::fchown(file, Some(older.uid()), Some(older.gid()));
            file.set_permissions(older.permissions())
        }
        #[cfg(not(unix))]
        {
            // Here permissions are of the folder, and "read-only" would forbid the rename.
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
                // A viewer or a virus scanner often holds the target for a moment.
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
