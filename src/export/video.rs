//! Films: numbered pictures, an animated GIF, or a video through the `ffmpeg` program on the path. No encoder
//! of videos is built in, because these are large and patent-encumbered.

use super::atomic::{folder_of, to_fault, write_atomic};
use super::error::ExportError;
use crate::math::image::RgbImage;
use gif::{EncodingError, Repeat};
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::fs::File;
use std::io;
use std::io::{BufWriter, Write};
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
    #[error("{}: expected ffmpeg to write this video, found: {found}; install ffmpeg, free disk space, or write a .gif or a folder of pictures", path.display())]
    Video { path: PathBuf, found: String },
    /// A GIF cannot hold pictures of this size or at this rate.
    #[error("{}: found {}×{} pixels at {fps} pictures per second, expected at most 65535 pixels a side and 0.002 to 50 pictures per second for a GIF; change them or write a .mp4", path.display(), size[0], size[1])]
    Gif { path: PathBuf, size: [u32; 2], fps: f64 },
}

const FFMPEG: &str = "ffmpeg";

struct VideoWriter {
    path: PathBuf,
    ffmpeg: Child,
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

fn ends_in(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(ending))
}

fn encoding(path: &Path) -> Option<&'static [&'static str]> {
    let known = ENDINGS.iter().find(|(ending, _)| ends_in(path, ending));
    known.map(|(_, encoding)| *encoding)
}

fn is_gif(path: &Path) -> bool {
    ends_in(path, "gif")
}

/// True for the extensions .gif, .mp4, .webm and .webp.
pub fn is_video(path: &Path) -> bool {
    is_gif(path) || encoding(path).is_some()
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
        let encoding = encoding(path).ok_or_else(|| {
            failed("a name that does not end in .gif, .mp4, .webm or .webp".into())
        })?;
        let growing = growing_folder(path)
            .map_err(|error| failed(format!("{} ({error})", folder_of(path).display())))?;
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
        publish(&folder, &path)
    }
}

/// Range of frame rates of a GIF: it counts hundredths of a second in 16 bits, and viewers slow down pictures
/// of one hundredth.
const GIF_FPS: std::ops::RangeInclusive<f64> = 0.002..=50.0;
/// A palette is fitted to one of this many pixels of its picture.
const PALETTE_SAMPLING: i32 = 10;

/// Writes an animated GIF frame by frame, each with a palette of its own.
struct GifWriter {
    path: PathBuf,
    size: [u16; 2],
    fps: f64,
    n: u32,
    encoder: gif::Encoder<BufWriter<File>>,
    folder: TempDir,
}

impl GifWriter {
    fn new(path: &Path, size: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        let sides = size.map(u16::try_from);
        let ([Ok(width), Ok(height)], true) = (sides, GIF_FPS.contains(&fps)) else {
            return Err(FilmError::Gif { path: path.to_owned(), size, fps });
        };
        let begin = || -> io::Result<_> {
            let folder = growing_folder(path)?;
            let file = BufWriter::new(File::create(folder.path().join(part_name(path)))?);
            let mut encoder =
                gif::Encoder::new(file, width, height, &[]).map_err(Self::disk_error)?;
            encoder.set_repeat(Repeat::Infinite).map_err(Self::disk_error)?;
            Ok((folder, encoder))
        };
        let (folder, encoder) =
            begin().map_err(|error| failure(path, "create a file in this folder", error, 0))?;
        Ok(Self { path: path.to_owned(), size: [width, height], fps, n: 0, encoder, folder })
    }

    fn push(&mut self, picture: &RgbImage) -> Result<(), FilmError> {
        let [width, height] = self.size;
        let pixels = picture.to_rgb8();
        let mut frame = gif::Frame::from_rgb_speed(width, height, &pixels, PALETTE_SAMPLING);
        // Times are rounded from the start, so that errors of single delays do not add up.
        let hundredths = |n: u32| (f64::from(n) * 100.0 / self.fps).round();
        frame.delay = (hundredths(self.n + 1) - hundredths(self.n)) as u16;
        self.n += 1;
        let written = self.encoder.write_frame(&frame).map_err(Self::disk_error);
        written
            .map_err(|error| failure(&self.path, "write", error, grown(&self.folder, &self.path)))
    }

    fn finish(self) -> Result<(), FilmError> {
        let Self { path, encoder, folder, .. } = self;
        let file = encoder.into_inner().map_err(Self::disk_error);
        let flushed = file.and_then(|mut file| file.flush());
        flushed.map_err(|error| failure(&path, "write", error, grown(&folder, &path)))?;
        publish(&folder, &path)
    }

    /// The error of the disk as it is, because its kind names a full disk.
    fn disk_error(error: EncodingError) -> io::Error {
        match error {
            EncodingError::Io(error) => error,
            other => io::Error::other(other),
        }
    }
}

fn failure(path: &Path, action: &'static str, error: io::Error, n_bytes: u64) -> FilmError {
    FilmError::Picture(to_fault(action, n_bytes)(error).with_path(path))
}

/// Creates a temporary folder beside a film, in which its file grows.
// A folder instead of a temporary file, so that the film has default permissions. Beside the output, because
// a rename across file systems fails.
fn growing_folder(path: &Path) -> io::Result<TempDir> {
    TempDir::with_prefix_in(".film-", folder_of(path))
}

/// Returns the size of the growing file, bytes.
fn grown(folder: &TempDir, path: &Path) -> u64 {
    folder.path().join(part_name(path)).metadata().map_or(0, |file| file.len())
}

/// Writes the complete film from its folder to `path`, as all other files: links are followed, and devices
/// are written to.
fn publish(folder: &TempDir, path: &Path) -> Result<(), FilmError> {
    let part = folder.path().join(part_name(path));
    write_atomic(path, |out| io::copy(&mut File::open(part)?, out).map(drop))?;
    Ok(())
}

/// Writer of a picture sequence, or of a film whose file appears once it is complete.
pub struct FilmWriter(Output);

enum Output {
    /// Numbered PNG files, each written immediately.
    Pictures {
        folder: PathBuf,
        /// Part of the file names after the number.
        suffix: String,
        n: usize,
    },
    Gif(Box<GifWriter>),
    Video(VideoWriter),
}

impl FilmWriter {
    /// Creates a GIF or video of pictures of `size` (width and height in pixels) if `output` has an extension
    /// of one ([`is_video`]), else a folder of pictures.
    ///
    /// # Errors
    /// [`FilmError::Folder`]; [`FilmError::Gif`] for a size or rate that a GIF does not have;
    /// [`FilmError::Picture`] if the folder of a GIF is not writable; or [`FilmError::Video`] if that of a
    /// video is not, or ffmpeg is missing.
    pub fn new(output: &Path, size: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        match is_video(output) {
            true if is_gif(output) => {
                Ok(Self(Output::Gif(Box::new(GifWriter::new(output, size, fps)?))))
            }
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

    /// Appends a picture of the film's size. Returns false if the encoder accepts no more pictures;
    /// [`Self::finish`] then returns the cause.
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
            Output::Gif(film) => film.push(picture).map(|()| true),
            Output::Video(video) => Ok(video.push(picture).is_ok()),
        }
    }

    /// Completes the output.
    ///
    /// # Errors
    /// [`FilmError::Picture`] of a GIF, or [`FilmError::Video`] with the first line of ffmpeg's error
    /// output, or a system error.
    pub fn finish(self) -> Result<(), FilmError> {
        match self.0 {
            Output::Pictures { .. } => Ok(()),
            Output::Gif(film) => film.finish(),
            Output::Video(video) => video.finish(),
        }
    }

    /// Aborts the output. Pictures already written are kept, and an unfinished film is removed.
    pub fn abort(self) {
        match self.0 {
            // Dropping a GIF removes its folder.
            Output::Pictures { .. } | Output::Gif(_) => {}
            Output::Video(video) => video.abort(),
        }
    }
}

/// Bytes per pixel for colour, coverage, depth and the encoded file. Measured with images of 16 and 64
/// million pixels.
const PIXEL_BYTES: u64 = 40;

/// Returns the text of an error if rendering and writing a picture of `size` (width and height in pixels)
/// needs more than `available` bytes, or `None` if it fits. A failed allocation would abort the program.
pub fn too_large(size: [u32; 2], available: u64) -> Option<String> {
    let [width, height] = size.map(u64::from);
    let needed = width * height * PIXEL_BYTES;
    (needed > available).then(|| {
        format!(
            "expected at most {} pixels, which the {} MB of free memory hold, found {width}x{height} ({} MB); take a smaller picture or close other programs",
            available / PIXEL_BYTES,
            available / 1_000_000,
            needed.div_ceil(1_000_000)
        )
    })
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
    fn pictures_that_do_not_fit_are_refused() {
        assert_eq!(too_large([1280, 720], 1280 * 720 * PIXEL_BYTES), None);
        let said = too_large([16_384, 16_384], 400_000_000).unwrap_or_default();
        for part in ["expected at most 10000000 pixels", "400 MB", "16384x16384"] {
            assert!(said.contains(part), "{said}");
        }
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
        let mut gif = FilmWriter::new(&folder.path().join("film.gif"), [8, 6], 30.0).unwrap();
        assert!(gif.push(&picture).unwrap());
        gif.abort();
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1, "the pictures alone");
        for (size, fps) in [([65_536, 6], 30.0), ([8, 6], 51.0), ([8, 6], 0.001)] {
            let refused = FilmWriter::new(&folder.path().join("film.gif"), size, fps);
            assert!(matches!(refused, Err(FilmError::Gif { .. })), "{size:?} at {fps}");
        }
        let nowhere = FilmWriter::new(&folder.path().join("none/film.gif"), [8, 6], 30.0);
        let error = nowhere.err().unwrap().to_string();
        assert!(error.contains("film.gif") && error.contains("folder"), "{error}");
        let is_file = FilmWriter::new(&output.join("00000-exact.png"), [8, 6], 30.0);
        assert!(matches!(is_file, Err(FilmError::Folder { .. })));
    }
}
