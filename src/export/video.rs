//! Video output through the `ffmpeg` program on the path. No encoder is built in, because encoders are large
//! and patent-encumbered.

use super::atomic::{folder_of, write_atomic};
use super::error::ExportError;
use crate::math::image::RgbImage;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Command, Stdio};
use tempfile::TempDir;

/// Error of writing a picture sequence or a video.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The folder could not be created.
    #[error("{}: expected a folder to write to, but it could not be created ({error}); choose another", path.display())]
    Folder { path: PathBuf, error: io::Error },
    /// A picture could not be written.
    #[error(transparent)]
    Picture(#[from] ExportError),
    /// The video could not be written, as ffmpeg or the system reported.
    #[error("{}: expected ffmpeg to write this video, found: {found}; install ffmpeg, free disk space, or write pictures to a folder", path.display())]
    Video { path: PathBuf, found: String },
}

const FFMPEG: &str = "ffmpeg";

struct VideoWriter {
    path: PathBuf,
    ffmpeg: Child,
    // A folder instead of a temporary file, so that ffmpeg creates the video with default permissions. Beside
    // the output, because a rename across file systems fails.
    folder: TempDir,
}

/// Video file extensions, each with the encoder options for ffmpeg.
// Qualities are visually near lossless, and most players know the pixel format.
const ENDINGS: [(&str, &[&str]); 3] = [
    // `+faststart` moves the index to the front, so that players can stream the file.
    ("mp4", &["-c:v", "libx264", "-crf", "18", "-pix_fmt", "yuv420p", "-movflags", "+faststart"]),
    ("webm", &["-c:v", "libvpx-vp9", "-crf", "28", "-b:v", "0", "-pix_fmt", "yuv420p"]),
    ("webp", &["-c:v", "libwebp", "-quality", "85", "-loop", "0"]),
];

fn encoding(path: &Path) -> Option<&'static [&'static str]> {
    let extension = path.extension()?.to_str()?;
    let known = ENDINGS.iter().find(|(ending, _)| ending.eq_ignore_ascii_case(extension));
    known.map(|(_, encoding)| *encoding)
}

/// True for the extensions .mp4, .webm and .webp.
pub fn is_video(path: &Path) -> bool {
    encoding(path).is_some()
}

/// Checks that ffmpeg can be started if `output` is a video.
///
/// # Errors
/// [`FilmError::Video`].
pub fn check_encoder(output: &Path) -> Result<(), FilmError> {
    let start = || {
        Command::new(FFMPEG).arg("-version").stdout(Stdio::null()).stderr(Stdio::null()).status()
    };
    match is_video(output).then(start) {
        None | Some(Ok(_)) => Ok(()),
        Some(Err(error)) => {
            Err(FilmError::Video { path: output.to_owned(), found: not_runnable(error) })
        }
    }
}

fn not_runnable(error: io::Error) -> String {
    format!("no runnable ffmpeg ({error})")
}

fn part_name(path: &Path) -> PathBuf {
    // ffmpeg derives the container from the extension.
    Path::new("video").with_extension(path.extension().unwrap_or_default())
}

impl VideoWriter {
    fn new(path: &Path, [width, height]: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        let failed = |found: String| FilmError::Video { path: path.to_owned(), found };
        let encoding = encoding(path)
            .ok_or_else(|| failed("a name that does not end in .mp4, .webm or .webp".into()))?;
        let folder = folder_of(path);
        let growing = TempDir::with_prefix_in(".video-", folder)
            .map_err(|error| failed(format!("{} ({error})", folder.display())))?;
        // An absolute path, because a name with a leading dash would be read as an option.
        let target = std::path::absolute(growing.path().join(part_name(path)))
            .map_err(|error| failed(error.to_string()))?;
        let mut ffmpeg = Command::new(FFMPEG);
        // With `-xerror`, as a disk that is full at the end would pass for success otherwise.
        ffmpeg.args(["-v", "error", "-xerror", "-y", "-f", "rawvideo", "-pix_fmt", "rgb24"]);
        ffmpeg.args(["-s", &format!("{width}x{height}"), "-r", &fps.to_string(), "-i", "-"]);
        // Most players require even dimensions.
        ffmpeg.args(["-vf", "pad=ceil(iw/2)*2:ceil(ih/2)*2"]).args(encoding).arg(target);
        // `finish` reads the errors; other output is not needed.
        ffmpeg.stdin(Stdio::piped()).stdout(Stdio::null()).stderr(Stdio::piped());
        let ffmpeg = ffmpeg.spawn().map_err(|e| failed(not_runnable(e)))?;
        Ok(Self { path: path.to_owned(), ffmpeg, folder: growing })
    }

    fn push(&mut self, image: &RgbImage) -> io::Result<()> {
        match &mut self.ffmpeg.stdin {
            Some(stdin) => stdin.write_all(&image.to_rgb8()),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        }
    }

    fn abort(mut self) {
        // Fails if ffmpeg has already exited.
        let _ = self.ffmpeg.kill();
        let _ = self.ffmpeg.wait();
    }

    fn finish(self) -> Result<(), FilmError> {
        let Self { path, ffmpeg, folder } = self;
        let failed = |found: String| FilmError::Video { path: path.clone(), found };
        let output = ffmpeg.wait_with_output().map_err(|error| failed(error.to_string()))?;
        if !output.status.success() {
            let said = String::from_utf8_lossy(&output.stderr);
            // The first line states the cause, further ones its consequences.
            return Err(failed(said.lines().next().unwrap_or("a failure of ffmpeg").to_owned()));
        }
        let part = folder.path().join(part_name(&path));
        let mut video = std::fs::File::open(part).map_err(|error| failed(error.to_string()))?;
        // As all other files: links are followed, and devices are written to.
        write_atomic(&path, |out| io::copy(&mut video, out).map(drop))?;
        Ok(())
    }
}

/// Writer of a picture sequence, or of a video whose file appears once it is complete.
pub struct FilmWriter(Output);

enum Output {
    /// Numbered PNG files, each written immediately.
    Pictures {
        folder: PathBuf,
        /// Part of the file names after the number.
        suffix: String,
        n: usize,
    },
    Video(VideoWriter),
}

impl FilmWriter {
    /// Creates a video if `output` has a video extension ([`is_video`]), else a folder of pictures.
    ///
    /// # Errors
    /// [`FilmError::Folder`], or [`FilmError::Video`] if the folder is not writable or ffmpeg is
    /// missing.
    pub fn new(output: &Path, size: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        match is_video(output) {
            true => Ok(Self(Output::Video(VideoWriter::new(output, size, fps)?))),
            false => Self::pictures(output, ""),
        }
    }

    /// Creates a folder of pictures named `00000{suffix}.png` and so on.
    ///
    /// # Errors
    /// [`FilmError::Folder`].
    pub fn pictures(folder: &Path, suffix: &str) -> Result<Self, FilmError> {
        let failed = |error| FilmError::Folder { path: folder.to_owned(), error };
        std::fs::create_dir_all(folder).map_err(failed)?;
        let (folder, suffix) = (folder.to_owned(), suffix.to_owned());
        Ok(Self(Output::Pictures { folder, suffix, n: 0 }))
    }

    /// Appends a picture. Returns false if ffmpeg accepts no more pictures; [`Self::finish`] then
    /// returns the cause.
    ///
    /// # Errors
    /// [`FilmError::Picture`].
    pub fn push(&mut self, picture: &RgbImage) -> Result<bool, FilmError> {
        match &mut self.0 {
            Output::Pictures { folder, suffix, n } => {
                write_png(&folder.join(format!("{n:05}{suffix}.png")), picture)?;
                *n += 1;
                Ok(true)
            }
            Output::Video(video) => Ok(video.push(picture).is_ok()),
        }
    }

    /// Completes the output.
    ///
    /// # Errors
    /// [`FilmError::Video`] with the first line of ffmpeg's error output, or a system error.
    pub fn finish(self) -> Result<(), FilmError> {
        match self.0 {
            Output::Pictures { .. } => Ok(()),
            Output::Video(video) => video.finish(),
        }
    }

    /// Aborts the output. Pictures already written are kept, and an unfinished video is removed.
    pub fn abort(self) {
        if let Output::Video(video) = self.0 {
            video.abort();
        }
    }
}

/// Writes a picture as PNG, atomically.
///
/// # Errors
/// Those of [`write_atomic`].
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), ExportError> {
    let size = [picture.width, picture.height];
    write_atomic(path, |out| encode_png(out, &picture.to_rgb8(), size)).map(drop)
}

/// Writes rows of red, green and blue bytes as PNG. `size` is width and height.
pub(super) fn encode_png(mut out: impl Write, rgb: &[u8], size: [usize; 2]) -> io::Result<()> {
    let [width, height] = size.map(|n| n as u32);
    // In memory first: the encoder would hide the kind of a write error, such as a full disk.
    let mut png = Vec::new();
    PngEncoder::new(&mut png)
        .write_image(rgb, width, height, ExtendedColorType::Rgb8)
        .map_err(io::Error::other)?;
    out.write_all(&png)
}

#[cfg(test)]
mod film_tests {
    use super::*;

    #[test]
    fn a_full_disk_is_told_as_such() {
        struct Full;
        impl Write for Full {
            fn write(&mut self, _: &[u8]) -> io::Result<usize> {
                Err(io::ErrorKind::StorageFull.into())
            }

            fn flush(&mut self) -> io::Result<()> {
                Ok(())
            }
        }
        let error = encode_png(Full, &[0; 3], [1, 1]).unwrap_err();
        assert_eq!(error.kind(), io::ErrorKind::StorageFull, "{error}");
    }

    #[test]
    fn pictures_are_numbered_and_a_video_given_up_leaves_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let picture = RgbImage::filled(8, 6, [0.5, 0.25, 1.0]);
        let output = folder.path().join("film");
        let mut film = FilmWriter::pictures(&output, "-exact").unwrap();
        assert!(film.push(&picture).unwrap() && film.push(&picture).unwrap());
        film.finish().unwrap();
        for name in ["00000-exact.png", "00001-exact.png"] {
            let read = image::open(output.join(name)).unwrap().to_rgb8();
            assert_eq!((read.dimensions(), read.get_pixel(3, 2).0), ((8, 6), [128, 64, 255]));
        }
        // Without ffmpeg no video is started.
        let video = folder.path().join("film.mp4");
        if let Ok(mut film) = FilmWriter::new(&video, [8, 6], 30.0) {
            let _ = film.push(&picture);
            film.abort();
        }
        assert!(!video.exists());
        let is_file = FilmWriter::new(&output.join("00000-exact.png"), [8, 6], 30.0);
        assert!(matches!(is_file, Err(FilmError::Folder { .. })));
    }
}
