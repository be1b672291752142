//! Output of pictures along a camera path, as PNG files in a folder or as a video.

use super::atomic::write_atomic;
use super::error::ExportError;
use super::video::{VideoError, VideoWriter, is_video};
use crate::math::image::RgbImage;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::path::{Path, PathBuf};

/// Error of writing a film.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The folder could not be created.
    #[error("{}: expected a folder to write to, but it could not be created ({error}); choose another", path.display())]
    Folder {
        /// Path of the folder.
        path: PathBuf,
        /// Error of the operating system.
        error: io::Error,
    },
    /// A picture could not be written.
    #[error(transparent)]
    Picture(#[from] ExportError),
    /// The video could not be written.
    #[error(transparent)]
    Video(#[from] VideoError),
}

/// Writer of a picture sequence or a video.
pub enum FilmWriter {
    /// Numbered PNG files, each written immediately.
    Pictures {
        /// Output folder.
        folder: PathBuf,
        /// Suffix of the names, after the number.
        suffix: String,
        /// Number of pictures written.
        n: usize,
    },
    /// A video, whose file appears once it is complete.
    Video(VideoWriter),
}

impl FilmWriter {
    /// Creates a video if `output` has a video extension ([`is_video`]), else a folder of pictures.
    ///
    /// # Errors
    /// Those of [`VideoWriter::new`], or [`FilmError::Folder`].
    pub fn new(output: &Path, size: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        match is_video(output) {
            true => Ok(Self::Video(VideoWriter::new(output, size, fps)?)),
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
        Ok(Self::Pictures { folder: folder.to_owned(), suffix: suffix.to_owned(), n: 0 })
    }

    /// Appends a picture. Returns false if a video accepts no more; [`Self::finish`] then returns the cause.
    ///
    /// # Errors
    /// [`FilmError::Picture`].
    pub fn push(&mut self, picture: &RgbImage) -> Result<bool, FilmError> {
        match self {
            Self::Pictures { folder, suffix, n } => {
                write_png(&folder.join(format!("{n:05}{suffix}.png")), picture)?;
                *n += 1;
                Ok(true)
            }
            Self::Video(video) => Ok(video.push(picture).is_ok()),
        }
    }

    /// Completes the output.
    ///
    /// # Errors
    /// Those of [`VideoWriter::finish`].
    pub fn finish(self) -> Result<(), FilmError> {
        match self {
            Self::Pictures { .. } => Ok(()),
            Self::Video(video) => Ok(video.finish()?),
        }
    }

    /// Aborts: pictures already written stay, an unfinished video is removed.
    pub fn abort(self) {
        if let Self::Video(video) = self {
            video.abort();
        }
    }
}

/// Writes a picture as PNG, atomically.
///
/// # Errors
/// Those of [`write_atomic`].
pub fn write_png(path: &Path, picture: &RgbImage) -> Result<(), ExportError> {
    let (width, height) = (picture.width as u32, picture.height as u32);
    let written = write_atomic(path, |out| {
        PngEncoder::new(out)
            .write_image(&picture.to_rgb8(), width, height, ExtendedColorType::Rgb8)
            .map_err(io::Error::other)
    });
    written.map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

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
