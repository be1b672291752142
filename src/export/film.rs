//! Pictures along a camera path as files: PNG pictures in a folder, or a video.

use super::atomic::write_atomic;
use super::error::ExportError;
use super::video::{VideoError, VideoWriter, is_video};
use crate::math::image::RgbImage;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io;
use std::path::{Path, PathBuf};

/// Why there is no film.
#[derive(Debug, thiserror::Error)]
pub enum FilmError {
    /// The folder for its pictures.
    #[error("{}: expected a folder to write to, which could not be created ({error}); choose another", path.display())]
    Folder {
        /// The folder.
        path: PathBuf,
        /// Of the system.
        error: io::Error,
    },
    /// One of its pictures.
    #[error(transparent)]
    Picture(#[from] ExportError),
    /// The video.
    #[error(transparent)]
    Video(#[from] VideoError),
}

/// A film that is being written.
pub enum FilmWriter {
    /// Pictures that are there as soon as they are drawn.
    Pictures {
        /// Where they lie.
        folder: PathBuf,
        /// What follows their numbers.
        suffix: String,
        /// How many are there.
        n: usize,
    },
    /// A video, which appears whole.
    Video(VideoWriter),
}

impl FilmWriter {
    /// A video where the name is that of one ([`is_video`]), else pictures in a folder, made if need be.
    ///
    /// # Errors
    /// Those of [`VideoWriter::new`], or a folder that cannot be made.
    pub fn new(output: &Path, size: [u32; 2], fps: f64) -> Result<Self, FilmError> {
        match is_video(output) {
            true => Ok(Self::Video(VideoWriter::new(output, size, fps)?)),
            false => Self::pictures(output, ""),
        }
    }

    /// Pictures in a folder, `00000.png` and on, with a suffix of their names before the point.
    ///
    /// # Errors
    /// [`FilmError::Folder`].
    pub fn pictures(folder: &Path, suffix: &str) -> Result<Self, FilmError> {
        let failed = |error| FilmError::Folder { path: folder.to_owned(), error };
        std::fs::create_dir_all(folder).map_err(failed)?;
        Ok(Self::Pictures { folder: folder.to_owned(), suffix: suffix.to_owned(), n: 0 })
    }

    /// Appends a picture; whether more are taken: where a video takes none, [`Self::finish`] says why.
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

    /// Ends it.
    ///
    /// # Errors
    /// Those of [`VideoWriter::finish`].
    pub fn finish(self) -> Result<(), FilmError> {
        match self {
            Self::Pictures { .. } => Ok(()),
            Self::Video(video) => Ok(video.finish()?),
        }
    }

    /// Gives it up: pictures that are there stay, of a video nothing does.
    pub fn give_up(self) {
        if let Self::Video(video) = self {
            video.give_up();
        }
    }
}

/// Writes a picture as PNG, whole or not at all.
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
        // Where there is no ffmpeg, there is nothing to give up.
        let video = folder.path().join("film.mp4");
        if let Ok(mut film) = FilmWriter::new(&video, [8, 6], 30.0) {
            let _ = film.push(&picture);
            film.give_up();
        }
        assert!(!video.exists());
        let is_file = FilmWriter::new(&output.join("00000-exact.png"), [8, 6], 30.0);
        assert!(matches!(is_file, Err(FilmError::Folder { .. })));
    }
}
