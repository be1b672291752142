//! Opening what foreign folders and command lines call a file: it may be a FIFO that nobody writes to,
//! a device without an end, or larger than memory.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::path::Path;

/// Settings of a day's recording, an exposure for every frame among them, are shorter.
const MAX_SETTINGS_BYTES: u64 = 64 << 20;
/// No image, depth file or map of a frame is larger; members of archives may not be either.
pub(super) const MAX_IMAGE_BYTES: u64 = 256 << 20;

/// Opens a file for reading, and nothing that would hang or never end.
pub(super) fn open_file(path: &Path) -> IoResult<File> {
    // Asked before it is opened: opening a FIFO waits for whoever writes to it.
    match std::fs::metadata(path)?.is_file() {
        true => File::open(path),
        false => Err(Error::other("a folder, FIFO or device where a file was expected")),
    }
}

/// Whether a file is there. What a disk does not tell is an error, and no file that is missing.
pub(super) fn is_file(path: &Path) -> IoResult<bool> {
    match std::fs::metadata(path) {
        Ok(metadata) => Ok(metadata.is_file()),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(false),
        Err(e) => Err(e),
    }
}

/// A file whose reads are asked again where a signal interrupts them, as disks of a network let happen: not
/// every decoder does so.
#[derive(Debug)]
pub(super) struct PatientFile(File);

impl PatientFile {
    /// Opened as by [`open_file`].
    pub fn open(path: &Path) -> IoResult<Self> {
        open_file(path).map(Self)
    }
}

impl Read for PatientFile {
    fn read(&mut self, bytes: &mut [u8]) -> IoResult<usize> {
        loop {
            match self.0.read(bytes) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                done => return done,
            }
        }
    }
}

impl Seek for PatientFile {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.0.seek(to)
    }
}

/// All bytes of a file that has at most so many.
pub(super) fn bytes_of(path: &Path, most: u64) -> IoResult<Vec<u8>> {
    let mut file = open_file(path)?;
    let size = file.metadata()?.len();
    if size > most {
        let (found, most) = (size.div_ceil(1 << 20), most >> 20);
        return Err(Error::other(format!("{found} MiB where {most} MiB are more than any needs")));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    // It may have grown since.
    file.by_ref().take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// The text of a file of settings.
///
/// # Errors
/// What the system says, or that it is no file, far too large, or no UTF-8.
pub fn read_settings(path: &Path) -> IoResult<String> {
    let bytes = bytes_of(path, MAX_SETTINGS_BYTES)?;
    String::from_utf8(bytes)
        .map_err(|e| Error::new(ErrorKind::InvalidData, format!("text that is no UTF-8 ({e})")))
}
