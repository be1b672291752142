//! Photographs inside a video, taken out by the `ffmpeg` on the path.
//!
//! Phones store colour as HEVC, whose decoders are large and encumbered; everybody who handles such
//! videos has one. It runs once, at the first photograph that is asked for, into a folder that
//! disappears with the dataset.

use super::error::FrameProblem;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A video beside a recording's other files.
#[derive(Debug)]
pub(super) struct Video {
    path: PathBuf,
    frames: OnceLock<Result<TempDir, String>>,
}

impl Video {
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: OnceLock::new() }
    }

    /// Whether an `ffmpeg` answers on the path.
    pub fn can_be_read() -> bool {
        let quiet = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
        quiet.is_ok_and(|output| output.status.success())
    }

    /// The video's own path.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The image file of a frame, counted from 0.
    pub fn frame(&self, index: usize) -> Result<PathBuf, FrameProblem> {
        let unpacked = self.frames.get_or_init(|| unpack(&self.path));
        let folder = unpacked.as_ref().map_err(|found| FrameProblem::Video(found.clone()))?;
        let file = folder.path().join(format!("{index:06}.jpg"));
        match file.is_file() {
            true => Ok(file),
            false => Err(FrameProblem::Video(format!("no frame {index} in it"))),
        }
    }
}

fn unpack(path: &Path) -> Result<TempDir, String> {
    let folder = TempDir::new().map_err(|e| e.to_string())?;
    let output = Command::new("ffmpeg")
        .args(["-nostdin", "-v", "error", "-i"])
        // A name that begins with a dash or a protocol would be read as one.
        .arg(std::path::absolute(path).map_err(|e| e.to_string())?)
        .args(["-fps_mode", "passthrough", "-q:v", "2", "-start_number", "0"])
        .arg(folder.path().join("%06d.jpg"))
        .output()
        .map_err(|e| format!("no ffmpeg that runs ({e})"))?;
    if output.status.success() {
        return Ok(folder);
    }
    let said = String::from_utf8_lossy(&output.stderr);
    Err(said.lines().next().unwrap_or("a failure of ffmpeg").to_owned())
}
