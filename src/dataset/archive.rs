//! Members of an untrusted zip archive: the sizes in its directory may be wrong, and a member of one
//! kilobyte may unpack to a terabyte.

use super::error::FrameProblem;
use super::folder::{MAX_IMAGE_BYTES, RetryingFile, starts_with, text_of};
use super::lengths::MAX_FACTOR;
use std::borrow::Cow;
use std::io::{BufReader, Error, Read, Result as IoResult, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Arc, Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

const MAGIC: [u8; 4] = *b"PK\x03\x04";
/// Size limit for an unpacked text, bytes.
const MAX_TEXT_BYTES: u64 = 64 << 20;

#[derive(Debug)]
pub(super) struct Archive {
    pub path: PathBuf,
    // Reading moves the shared file position, hence the lock; decoding happens outside it.
    zip: Mutex<Zip<BufReader<RetryingFile>>>,
}

type Zip<R> = ZipArchive<CountedHeaders<R>>;

impl Archive {
    /// True if the file starts with the signature of a zip archive.
    ///
    /// # Errors
    /// Disk errors, so that an unreadable file is not mistaken for another kind of file.
    pub fn is_zip_archive(path: &Path) -> std::io::Result<bool> {
        starts_with(path, MAGIC)
    }

    pub fn open(path: &Path) -> Result<Self, FrameProblem> {
        let zip = open_zip(BufReader::new(RetryingFile::open(path)?))?;
        Ok(Self { path: path.to_owned(), zip: Mutex::new(zip) })
    }

    pub fn names(&self) -> Vec<String> {
        // Metadata cannot name a member whose name is not text, so such members are left out.
        self.lock().file_names().filter_map(Result::ok).map(Cow::into_owned).collect()
    }

    pub fn read(&self, name: &str) -> Result<Vec<u8>, FrameProblem> {
        read_member(&mut self.lock(), name, MAX_IMAGE_BYTES)
    }

    pub fn read_text(&self, name: &str) -> Result<String, FrameProblem> {
        Ok(text_of(read_member(&mut self.lock(), name, MAX_TEXT_BYTES)?)?)
    }

    fn lock(&self) -> std::sync::MutexGuard<'_, Zip<BufReader<RetryingFile>>> {
        // A panic while unpacking leaves no state that the next seek does not reset.
        self.zip.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Largest number of members of an archive, which take 700 bytes of memory each: 43,000 frames of three files.
pub(super) const MAX_MEMBERS: u64 = 1 << 17;
/// First bytes of a member's header in the directory of an archive.
const HEADER: [u8; 4] = *b"PK\x01\x02";

/// Opens an archive, unless its directory, or what is tried as such, has more members than [`MAX_MEMBERS`].
pub(super) fn open_zip<R: Read + Seek>(source: R) -> Result<Zip<R>, FrameProblem> {
    let left = Arc::new(AtomicU64::new(MAX_MEMBERS + 1));
    let zip = ZipArchive::new(CountedHeaders { source, left: left.clone() });
    // Members may hold archives, whose headers do not count.
    match left.swap(u64::MAX, Ordering::Relaxed) {
        0 => Err(FrameProblem::ArchiveMembers),
        _ => zip.map_err(archive_error),
    }
}

/// Source of an archive that fails once more headers of members than a limit were read. Counts in records at
/// the end do not bound them: an archive may hold several such records, and at any place.
#[derive(Debug)]
pub(super) struct CountedHeaders<R> {
    source: R,
    /// Number of headers that may still be read; 0 after too many.
    left: Arc<AtomicU64>,
}

impl<R: Read> Read for CountedHeaders<R> {
    fn read(&mut self, bytes: &mut [u8]) -> IoResult<usize> {
        let n = self.source.read(bytes)?;
        // Each header is read by a call of its own.
        if bytes.get(..n).is_some_and(|read| read.starts_with(&HEADER)) {
            let left = self.left.load(Ordering::Relaxed).saturating_sub(1);
            self.left.store(left, Ordering::Relaxed);
            if left == 0 {
                return Err(Error::other(format!("more than {MAX_MEMBERS} members")));
            }
        }
        Ok(n)
    }
}

impl<R: Seek> Seek for CountedHeaders<R> {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.source.seek(to)
    }
}

pub(super) fn read_member(
    zip: &mut ZipArchive<impl Read + Seek>,
    name: &str,
    most: u64,
) -> Result<Vec<u8>, FrameProblem> {
    let mut member = zip.by_name(name).map_err(archive_error)?;
    let (packed, stated) = (member.compressed_size(), member.size());
    if stated > most || stated / MAX_FACTOR > packed {
        return Err(FrameProblem::ZipBomb { packed, unpacked: stated });
    }
    // Grows with the data instead of being reserved: the stated size may still be wrong.
    let mut bytes = Vec::new();
    // One byte more than the stated size detects a longer member.
    member.by_ref().take(stated + 1).read_to_end(&mut bytes)?;
    if bytes.len() as u64 != stated {
        return Err(FrameProblem::ZipBomb { packed, unpacked: bytes.len() as u64 });
    }
    Ok(bytes)
}

fn archive_error(error: ZipError) -> FrameProblem {
    match error {
        // A disk error: exporting the recording again would not help.
        ZipError::Io(e) if e.raw_os_error().is_some() => FrameProblem::Read(e),
        other => FrameProblem::Archive(other.to_string()),
    }
}
