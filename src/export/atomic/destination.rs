//! Resolution of an output path: a regular file behind any links, or a stream.

use crate::export::error::Fault;
use std::io;
use std::path::{Path, PathBuf};

/// Maximum number of links followed before a cycle is assumed; Linux uses the same limit.
const MAX_LINKS: usize = 40;

pub(super) enum Destination {
    /// Existing or future regular file, with all links resolved.
    File(PathBuf),
    /// Device, FIFO or socket.
    Stream,
}

impl Destination {
    pub fn resolve(path: &Path) -> Result<Self, Fault> {
        match std::fs::metadata(path) {
            Ok(found) if found.is_dir() => Err(Fault::IsFolder),
            Ok(found) if !found.is_file() => Ok(Self::Stream),
            Ok(_) if path.is_symlink() => match path.canonicalize() {
                Ok(file) => Ok(Self::File(file)),
                Err(source) => Err(Fault::Io { action: "follow this link", source }),
            },
            Err(e) if path.is_symlink() => end_of_links(path, e).map(Self::File),
            // Any other problem with the path is reported when it is used.
            Ok(_) | Err(_) => Ok(Self::File(path.to_path_buf())),
        }
    }
}

/// Resolves a symbolic link whose target file does not exist.
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
