//! Photographs inside a video, extracted by the installed `ffmpeg`.
//!
//! Phones store colour as HEVC, whose decoders are large and encumbered by patents; users of such videos
//! usually have one. It runs once, when the first photograph is requested, into a temporary folder that is
//! deleted with the dataset.

use super::error::FrameProblem;
use super::files::is_file;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::sync::OnceLock;
use tempfile::TempDir;

/// A video among a recording's files.
#[derive(Debug)]
pub(super) struct Video {
    path: PathBuf,
    frames: OnceLock<Result<TempDir, String>>,
}

impl Video {
    pub fn new(path: PathBuf) -> Self {
        Self { path, frames: OnceLock::new() }
    }

    /// True if `ffmpeg` can be run.
    pub fn is_ffmpeg_available() -> bool {
        let quiet = Command::new("ffmpeg").arg("-version").stdin(Stdio::null()).output();
        quiet.is_ok_and(|output| output.status.success())
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Image file of a frame, counted from 0.
    pub fn frame(&self, index: usize) -> Result<PathBuf, FrameProblem> {
        let unpacked = self.frames.get_or_init(|| extract_frames(&self.path));
        let folder = unpacked.as_ref().map_err(|found| FrameProblem::Video(found.clone()))?;
        let file = folder.path().join(format!("{index:06}.jpg"));
        match is_file(&file)? {
            true => Ok(file),
            false => Err(FrameProblem::Video(format!("no frame {index} in it"))),
        }
    }
}

/// Option that extracts every frame once: since ffmpeg 5.1, and before it.
const EVERY_FRAME: [&str; 2] = ["-fps_mode", "-vsync"];

fn extract_frames(path: &Path) -> Result<TempDir, String> {
    let folder = TempDir::new().map_err(|e| e.to_string())?;
    // An absolute path: a relative name may start with a dash or a protocol prefix.
    let video = std::path::absolute(path).map_err(|e| e.to_string())?;
    let [option, older] = EVERY_FRAME;
    let mut output = run(&video, folder.path(), option)?;
    if !output.status.success() && first_line(&output).contains(option.trim_start_matches('-')) {
        output = run(&video, folder.path(), older)?;
    }
    match output.status.success() {
        true => Ok(folder),
        false => Err(first_line(&output)),
    }
}

fn run(video: &Path, folder: &Path, every_frame: &str) -> Result<Output, String> {
    let mut ffmpeg = Command::new("ffmpeg");
    // Without rotation metadata: the camera matrix refers to the sensor's orientation.
    ffmpeg.args(["-nostdin", "-v", "error", "-noautorotate", "-i"]).arg(video);
    ffmpeg.args([every_frame, "passthrough", "-q:v", "2", "-start_number", "0"]);
    let output = ffmpeg.arg(folder.join("%06d.jpg")).output();
    output.map_err(|e| format!("ffmpeg cannot be run ({e})"))
}

fn first_line(output: &Output) -> String {
    let said = String::from_utf8_lossy(&output.stderr);
    said.lines().next().unwrap_or("a failure of ffmpeg without a message").to_owned()
}
