//! Members of an untrusted zip archive: the sizes in its directory may be wrong, and a member of one
//! kilobyte may unpack to a terabyte.

use super::error::FrameProblem;
use super::folder::{MAX_IMAGE_BYTES, RetryingFile, starts_with, text_of};
use super::lengths::MAX_FACTOR;
use std::borrow::Cow;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use zip::ZipArchive;
use zip::result::ZipError;

const MAGIC: [u8; 4] = *b"PK\x03\x04";
/// Size limit for an unpacked text, bytes.
const MAX_TEXT_BYTES: u64 = 64 << 20;

#[derive(Debug)]
pub(super) struct Archive {
    pub path: PathBuf,
    // Reading moves the shared file position, hence the lock; decoding happens outside it.
    zip: Mutex<ZipArchive<BufReader<RetryingFile>>>,
}

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

    fn lock(&self) -> std::sync::MutexGuard<'_, ZipArchive<BufReader<RetryingFile>>> {
        // A panic while unpacking leaves no state that the next seek does not reset.
        self.zip.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Largest number of members of an archive, which take 700 bytes of memory each: 43,000 frames of three files.
pub(super) const MAX_MEMBERS: u64 = 1 << 17;
/// Longest end of an archive, bytes: its comment, the record before it and the locator before that.
const MAX_END: u64 = (1 << 16) + 22 + 20;

/// Opens an archive, unless it states more members than [`MAX_MEMBERS`].
pub(super) fn open_zip<R: Read + Seek>(mut source: R) -> Result<ZipArchive<R>, FrameProblem> {
    let found = stated_members(&mut source)?;
    match found <= MAX_MEMBERS {
        true => ZipArchive::new(source).map_err(archive_error),
        false => Err(FrameProblem::ArchiveMembers(found)),
    }
}

/// Returns the largest number of members that a record of zip64 states; without such a record, an archive has at
/// most 65,535.
fn stated_members(source: &mut (impl Read + Seek)) -> std::io::Result<u64> {
    const LOCATOR: usize = 20;
    const RECORD: u64 = 56;
    let size = source.seek(SeekFrom::End(0))?;
    let start = size.saturating_sub(MAX_END);
    source.seek(SeekFrom::Start(start))?;
    let mut end = Vec::new();
    source.by_ref().take(MAX_END).read_to_end(&mut end)?;
    let mut most = 0;
    for (at, locator) in end.array_windows::<{ LOCATOR + 4 }>().enumerate() {
        let [b'P', b'K', 6, 7, _, _, _, _, a, b, c, d, e, f, g, h, .., b'P', b'K', 5, 6] = *locator
        else {
            continue;
        };
        let stated = u64::from_le_bytes([a, b, c, d, e, f, g, h]);
        // Before an archive there may be other bytes, which shift the stated place.
        for place in [stated, (start + at as u64).saturating_sub(RECORD)] {
            let mut record = [0; RECORD as usize];
            let is_read = source.seek(SeekFrom::Start(place)).is_ok()
                && source.read_exact(&mut record).is_ok();
            if is_read && record.starts_with(b"PK\x06\x06") {
                let counts = record.get(24..40).unwrap_or_default().as_chunks::<8>().0;
                most = counts.iter().map(|n| u64::from_le_bytes(*n)).fold(most, u64::max);
            }
        }
    }
    source.rewind()?;
    Ok(most)
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
