//! Pictures as a video, put together by the `ffmpeg` on the path: encoders are large and encumbered, and
//! whoever wants a video has one.

use crate::math::image::RgbImage;
use std::io::{self, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;

/// Why there is no video.
#[derive(Debug, thiserror::Error)]
#[error("{}: expected ffmpeg to write this video, found: {found}; install ffmpeg, or write pictures into a folder", path.display())]
pub struct VideoError {
    /// The video.
    pub path: PathBuf,
    /// What ffmpeg or the system said.
    pub found: String,
}

/// A video that is being written: it appears whole, or not at all.
pub struct VideoWriter {
    path: PathBuf,
    ffmpeg: Child,
    /// Where it grows, beside its place: a file of ffmpeg's own has the permissions that files have here.
    folder: TempDir,
}

/// Endings of videos, and how each is encoded: nearly as drawn, and playable anywhere.
const ENDINGS: [(&str, &[&str]); 3] = [
    ("mp4", &["-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]),
    ("webm", &["-c:v", "libvpx-vp9", "-crf", "28", "-b:v", "0", "-pix_fmt", "yuv420p"]),
    ("webp", &["-c:v", "libwebp", "-quality", "85", "-loop", "0"]),
];

fn encoding(path: &Path) -> Option<&'static [&'static str]> {
    let extension = path.extension()?.to_str()?;
    let known = ENDINGS.iter().find(|(ending, _)| ending.eq_ignore_ascii_case(extension));
    known.map(|(_, encoding)| *encoding)
}

/// Whether a name is that of a video: .mp4, .webm or .webp.
pub fn is_video(path: &Path) -> bool {
    encoding(path).is_some()
}

/// What it is called while it grows: ffmpeg takes the form from the ending.
fn part_name(path: &Path) -> PathBuf {
    Path::new("video").with_extension(path.extension().unwrap_or_default())
}

impl VideoWriter {
    /// Begins a video of so many pictures a second, each of `width` × `height` pixels.
    ///
    /// # Errors
    /// A name that is no video's ([`is_video`]), a folder that cannot be written to, no ffmpeg.
    pub fn new(path: &Path, [width, height]: [u32; 2], fps: f64) -> Result<Self, VideoError> {
        let failed = |found: String| VideoError { path: path.to_owned(), found };
        let encoding = encoding(path)
            .ok_or_else(|| failed("a name that ends in none of .mp4, .webm and .webp".into()))?;
        let folder = match path.parent() {
            Some(folder) if !folder.as_os_str().is_empty() => folder,
            _ => Path::new("."),
        };
        let growing = TempDir::with_prefix_in(".video-", folder)
            .map_err(|error| failed(format!("{} ({error})", folder.display())))?;
        // A name that begins with a dash would be read as an option.
        let target = std::path::absolute(growing.path().join(part_name(path)))
            .map_err(|error| failed(error.to_string()))?;
        let mut ffmpeg = Command::new("ffmpeg");
        ffmpeg.args(["-v", "error", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        ffmpeg.args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "-"]);
        // Most players want even sides.
        ffmpeg.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]).args(encoding).arg(target);
        ffmpeg.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let ffmpeg = ffmpeg.spawn().map_err(|e| failed(format!("no ffmpeg that runs ({e})")))?;
        Ok(Self { path: path.to_owned(), ffmpeg, folder: growing })
    }

    /// Appends a picture.
    ///
    /// # Errors
    /// ffmpeg takes no more; [`Self::finish`] says why.
    pub fn push(&mut self, image: &RgbImage) -> io::Result<()> {
        match &mut self.ffmpeg.stdin {
            Some(stdin) => stdin.write_all(&image.to_rgb8()),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    /// Gives the video up: nothing is left of it.
    pub fn give_up(mut self) {
        // One that has ended by itself needs no end.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
    }

    /// Ends the video and gives it its name.
    ///
    /// # Errors
    /// What ffmpeg says went wrong, or the system.
    pub fn finish(self) -> Result<(), VideoError> {
        let Self { path, ffmpeg, folder } = self;
        let failed = |found: String| VideoError { path: path.clone(), found };
        let output = ffmpeg.wait_with_output().map_err(|error| failed(error.to_string()))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            return Err(failed(said.lines().next().unwrap_or("a failure of ffmpeg").to_owned()));
        }
        let part = folder.path().join(part_name(&path));
        std::fs::rename(part, &path).map_err(|error| failed(error.to_string()))
    }
}
