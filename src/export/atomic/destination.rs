//! What the name of a file that is to be written stands for.

use crate::export::error::Fault;
use std::io;
use std::path::{Path, PathBuf};

/// Links followed from one name to the next before they count as a circle, as Linux counts.
const MAX_LINKS: usize = 40;

/// What a name stands for.
pub(super) enum Destination {
    /// A file that is there or will be, at the end of all links.
    File(PathBuf),
    /// A device, a FIFO, a socket.
    Stream,
}

impl Destination {
    pub fn of(path: &Path) -> Result<Self, Fault> {
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

pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    }
}
