//! Members of a zip archive, read without trust: what a directory says of a size is a promise that
//! the archive need not keep, and a member of a kilobyte may unpack to a terabyte.

use super::error::FrameProblem;
use super::files::{PatientFile, open_file};
use std::borrow::Cow;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

/// First bytes of a zip archive.
const MAGIC: [u8; 4] = *b"PK\x03\x04";
/// No member is unpacked to more bytes: a photograph of 100 megapixels has fewer.
const MAX_MEMBER_BYTES: u64 = 256 << 20;
/// Deflate reaches a factor of 1032; recordings of photographs and packed depth stay below 20.
const MAX_FACTOR: u64 = 1040;

/// An open zip archive.
pub(super) struct Archive {
    path: PathBuf,
    // Reading moves the one file position, hence the lock; decoding happens outside of it.
    zip: Mutex<ZipArchive<BufReader<PatientFile>>>,
}

impl Archive {
    /// Whether a file begins as a zip archive does. What a disk does not tell is an error.
    pub fn is_one(path: &Path) -> std::io::Result<bool> {
        let mut magic = [0; 4];
        match open_file(path).and_then(|mut file| file.read_exact(&mut magic)) {
            Ok(()) => Ok(magic == MAGIC),
            Err(e) if e.raw_os_error().is_some() => Err(e),
            // Too short, or no file.
            Err(_) => Ok(false),
        }
    }

    /// Reads the directory.
    pub fn open(path: &Path) -> Result<Self, FrameProblem> {
        let zip = ZipArchive::new(BufReader::new(PatientFile::open(path)?)).map_err(damaged)?;
        Ok(Self { path: path.to_owned(), zip: Mutex::new(zip) })
    }

    /// The archive's own path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Names of the members as the archive holds them; what is no name is left out.
    pub fn names(&self) -> Vec<String> {
        self.lock().file_names().filter_map(Result::ok).map(Cow::into_owned).collect()
    }

    /// The bytes of a member.
    pub fn read(&self, name: &str) -> Result<Vec<u8>, FrameProblem> {
        let mut zip = self.lock();
        let mut member = zip.by_name(name).map_err(damaged)?;
        let (packed, stated) = (member.compressed_size(), member.size());
        if stated > MAX_MEMBER_BYTES || stated / MAX_FACTOR > packed {
            return Err(FrameProblem::ZipBomb { packed, unpacked: stated });
        }
        let mut bytes = Vec::new();
        // One byte more than was promised tells a member that is longer.
        member.by_ref().take(stated + 1).read_to_end(&mut bytes)?;
        if bytes.len() as u64 != stated {
            return Err(FrameProblem::ZipBomb { packed, unpacked: bytes.len() as u64 });
        }
        Ok(bytes)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, ZipArchive<BufReader<PatientFile>>> {
        // A panic of the unpacker leaves nothing behind that the next seek does not set anew.
        self.zip.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl std::fmt::Debug for Archive {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Archive").field("path", &self.path).finish_non_exhaustive()
    }
}

fn damaged(error: ZipError) -> FrameProblem {
    match error {
        // The disk's fault, and no reason to share the recording again.
        ZipError::Io(e) if e.raw_os_error().is_some() => FrameProblem::Read(e),
        other => FrameProblem::Archive(other.to_string()),
    }
}
