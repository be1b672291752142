//! Members of an untrusted zip archive: the sizes in its directory may be wrong, and a member of one
//! kilobyte may unpack to a terabyte.

use super::error::{DatasetError, FrameProblem};
use super::folder::{MAX_IMAGE_BYTES, RetryingFile, starts_with, text_of};
use super::lengths::MAX_FACTOR;
use super::video::ExtractionFolder;
use crate::math::foreign;
use crate::math::foreign::CountedHeaders;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::borrow::Cow;
use std::fs::File;
use std::io::{BufReader, Read, Seek};
use std::path::{Component, Path, PathBuf};
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

/// Opens an archive, unless its directory has more members than [`MAX_MEMBERS`].
pub(super) fn open_zip<R: Read + Seek>(source: R) -> Result<Zip<R>, FrameProblem> {
    let zip = foreign::open_zip(source, MAX_MEMBERS).ok_or(FrameProblem::ArchiveMembers)?;
    zip.map_err(archive_error)
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

/// Largest size of an unpacked archive, bytes: an hour of a phone's photographs and depth is smaller.
const MAX_UNPACKED: u64 = 64 << 30;
/// Endings of photographs and videos, one of which every recording has.
const PICTURES: [&str; 9] = ["jpg", "jpeg", "png", "tif", "tiff", "exr", "mp4", "mov", "webp"];

/// Files of an archive in a temporary folder, which is deleted with the last dataset that reads them.
#[derive(Debug)]
pub(super) struct Unpacked {
    pub folder: PathBuf,
    _temporary: ExtractionFolder,
}

/// True if an archive may hold a recording's folder, by the names of its members.
pub(super) fn may_hold_folder(path: &Path) -> bool {
    let is_picture = |name: &String| {
        let ending = name.rsplit_once('.').map_or("", |(_, ending)| ending);
        PICTURES.iter().any(|picture| ending.eq_ignore_ascii_case(picture))
    };
    Archive::open(path).is_ok_and(|archive| archive.names().iter().any(is_picture))
}

/// Largest size of the description of splats in an archive, bytes; readers of SOG accept no larger one.
const MAX_DESCRIPTION_BYTES: u64 = 1 << 17;

/// True if an archive holds splats (SOG) instead of a recording. A damaged archive has only its name to go by.
pub(super) fn holds_splats(path: &Path) -> bool {
    /// What no other `meta.json` has together.
    #[derive(Deserialize)]
    struct Description {
        #[serde(rename = "means")]
        _means: IgnoredAny,
        #[serde(rename = "quats")]
        _rotations: IgnoredAny,
    }
    let Ok(archive) = Archive::open(path) else {
        return path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("sog"));
    };
    let text = read_member(&mut archive.lock(), "meta.json", MAX_DESCRIPTION_BYTES);
    text.is_ok_and(|text| serde_json::from_slice::<Description>(&text).is_ok())
}

/// Unpacks the files of an archive, member by member, into a temporary folder.
pub(super) fn unpack(path: &Path) -> Result<Unpacked, DatasetError> {
    // Not in `/tmp`, which is memory on many systems.
    let lasting = Path::new("/var/tmp");
    let parent = match std::env::var_os("TMPDIR").is_none() && lasting.is_dir() {
        true => lasting.to_owned(),
        false => std::env::temp_dir(),
    };
    let failed = |problem| {
        let (path, to) = (path.to_owned(), parent.clone());
        DatasetError::Unpack { path, to, problem: Box::new(problem) }
    };
    let unwritable = |source| failed(FrameProblem::Read(source));
    ExtractionFolder::remove_leftovers(&parent);
    let temporary = ExtractionFolder::create_in(&parent).map_err(unwritable)?;
    // Beside the folder's lock, whose name a member could have.
    let folder = temporary.path.path().join("files");
    std::fs::create_dir(&folder).map_err(unwritable)?;
    let source = RetryingFile::open(path).map_err(unwritable)?;
    let mut zip = open_zip(BufReader::new(source)).map_err(failed)?;
    let mut total = 0;
    for at in 0..zip.len() {
        total += unpack_member(&mut zip, at, &folder, MAX_UNPACKED - total).map_err(failed)?;
    }
    Ok(Unpacked { folder, _temporary: temporary })
}

/// Unpacks a file of at most `most` bytes and returns its size. Leaves out folders, links, names that lead
/// outside, and the files that a Mac adds.
fn unpack_member(
    zip: &mut ZipArchive<impl Read + Seek>,
    at: usize,
    folder: &Path,
    most: u64,
) -> Result<u64, FrameProblem> {
    let mut member = zip.by_index(at).map_err(archive_error)?;
    let name = member.enclosed_name().filter(|_| member.is_file() && !member.is_symlink());
    let Some(name) = name.filter(|name| !is_of_mac(name)) else { return Ok(0) };
    let (packed, stated) = (member.compressed_size(), member.size());
    let bomb = |unpacked| Err(FrameProblem::ZipBomb { packed, unpacked });
    if stated > most || stated / MAX_FACTOR > packed {
        return bomb(stated);
    }
    let target = folder.join(name);
    if let Some(parent) = target.parent() {
        std::fs::create_dir_all(parent)?;
    }
    // Two members of one name: neither can be trusted to be the one that is meant.
    let mut file = File::create_new(&target)?;
    let copied = std::io::copy(&mut member.by_ref().take(stated + 1), &mut file);
    let written = copied.map_err(|error| archive_error(ZipError::Io(error)))?;
    if written == stated { Ok(written) } else { bomb(written) }
}

fn is_of_mac(name: &Path) -> bool {
    let is_named = |part: Component| {
        part.as_os_str().to_str().is_some_and(|name| name == "__MACOSX" || name.starts_with("._"))
    };
    name.components().any(is_named)
}

fn archive_error(error: ZipError) -> FrameProblem {
    match error {
        // A disk error: exporting the recording again would not help.
        ZipError::Io(e) if e.raw_os_error().is_some() => FrameProblem::Read(e),
        other => FrameProblem::Archive(other.to_string()),
    }
}
