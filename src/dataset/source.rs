//! Sources of an image's bytes: a file, a member of an archive, a frame of a video.

use super::archive::Archive;
use super::error::FrameProblem;
use super::files::{MAX_IMAGE_BYTES, read_bytes};
use super::video::Video;
use std::path::{Path, PathBuf};
use std::sync::Arc;

#[derive(Clone, Debug)]
pub(super) enum ByteSource {
    /// A separate file.
    File(PathBuf),
    /// A member of an archive; `shown` is its path in messages.
    Member { archive: Arc<Archive>, name: String, shown: PathBuf },
    /// A frame of a video, counted from 0.
    VideoFrame { video: Arc<Video>, index: usize },
    /// Grey stand-in for a photograph that was not recorded; the file is the depth file.
    Grey(PathBuf),
}

impl ByteSource {
    pub fn member(archive: &Arc<Archive>, name: &str) -> Self {
        let shown = archive.path().join(name);
        Self::Member { archive: Arc::clone(archive), name: name.to_owned(), shown }
    }

    /// The path shown in messages.
    pub fn path(&self) -> &Path {
        match self {
            Self::File(path) | Self::Grey(path) => path,
            Self::Member { shown, .. } => shown,
            Self::VideoFrame { video, .. } => video.path(),
        }
    }

    /// The file on disk that contains the bytes.
    pub fn disk_path(&self) -> &Path {
        match self {
            Self::Member { archive, .. } => archive.path(),
            Self::File(_) | Self::Grey(_) | Self::VideoFrame { .. } => self.path(),
        }
    }

    pub fn read(&self) -> Result<Vec<u8>, FrameProblem> {
        match self {
            Self::File(path) | Self::Grey(path) => Ok(read_bytes(path, MAX_IMAGE_BYTES)?),
            Self::Member { archive, name, .. } => archive.read(name),
            Self::VideoFrame { video, index } => {
                Ok(read_bytes(&video.frame(*index)?, MAX_IMAGE_BYTES)?)
            }
        }
    }
}

impl From<PathBuf> for ByteSource {
    fn from(path: PathBuf) -> Self {
        Self::File(path)
    }
}
