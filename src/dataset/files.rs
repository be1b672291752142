//! Opens files from untrusted folders and command lines. A path may be a FIFO without a writer, an endless
//! device, or a file larger than memory.

use std::fs::File;
use std::io::{Error, ErrorKind, Read, Result as IoResult, Seek, SeekFrom};
use std::path::Path;

/// Limit for settings files; those of a day-long recording, with an exposure per frame, are smaller.
const MAX_SETTINGS_BYTES: u64 = 64 << 20;
/// Limit for an image, a depth file or a confidence map, also as a member of an archive.
pub(super) const MAX_IMAGE_BYTES: u64 = 256 << 20;

/// Opens a regular file for reading; refuses anything that could block or be endless.
pub(super) fn open_file(path: &Path) -> IoResult<File> {
    // Checked before opening: opening a FIFO blocks until it has a writer.
    match std::fs::metadata(path)?.is_file() {
        true => File::open(path),
        false => Err(Error::other("a folder, FIFO or device where a file was expected")),
    }
}

/// True if the file exists. Disk errors are returned, so that an unreadable file does not count as missing.
pub(super) fn is_file(path: &Path) -> IoResult<bool> {
    match std::fs::metadata(path) {
        Ok(metadata) => Ok(metadata.is_file()),
        Err(e) if matches!(e.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => Ok(false),
        Err(e) => Err(e),
    }
}

/// A file that retries reads interrupted by a signal, as happens on network drives; not every decoder does.
#[derive(Debug)]
pub(super) struct RetryingFile(File);

impl RetryingFile {
    pub fn open(path: &Path) -> IoResult<Self> {
        open_file(path).map(Self)
    }
}

impl Read for RetryingFile {
    fn read(&mut self, bytes: &mut [u8]) -> IoResult<usize> {
        loop {
            match self.0.read(bytes) {
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                done => return done,
            }
        }
    }
}

impl Seek for RetryingFile {
    fn seek(&mut self, to: SeekFrom) -> IoResult<u64> {
        self.0.seek(to)
    }
}

/// Reads a whole file of at most `most` bytes.
pub(super) fn read_bytes(path: &Path, most: u64) -> IoResult<Vec<u8>> {
    let mut file = open_file(path)?;
    let size = file.metadata()?.len();
    if size > most {
        let (found, most) = (size.div_ceil(1 << 20), most >> 20);
        return Err(Error::other(format!("{found} MiB, above the limit of {most} MiB")));
    }
    let mut bytes = Vec::with_capacity(size as usize);
    // The file may have grown since.
    file.by_ref().take(most).read_to_end(&mut bytes)?;
    Ok(bytes)
}

/// Reads a settings file as text.
///
/// # Errors
/// Errors of the system; not a regular file, too large, or not UTF-8.
pub fn read_settings(path: &Path) -> IoResult<String> {
    let bytes = read_bytes(path, MAX_SETTINGS_BYTES)?;
    String::from_utf8(bytes)
        .map_err(|e| Error::new(ErrorKind::InvalidData, format!("text that is not UTF-8 ({e})")))
}
