//! Writing of folders, text files and images, and the errors.

use crate::dataset::synthetic::params::ParamsError;
use crate::math::image::Image;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::path::{Path, PathBuf};

const JPEG_QUALITY: u8 = 95;

/// Error while writing a dataset.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// A parameter is outside its range.
    #[error("{0}")]
    Params(#[from] ParamsError),
    /// The folder is not empty. Existing files are never overwritten.
    #[error(
        "{}: expected a new or empty folder, found one with files; choose another", .0.display()
    )]
    NotEmpty(PathBuf),
    /// The layout cannot be written frame by frame.
    #[error(
        "layout {layout}: expected one that can be recorded frame by frame ({expected}), found one whose frames are in one file that is written at the end; choose another layout"
    )]
    NotLive { layout: String, expected: &'static str },
    /// A folder or file cannot be written.
    #[error("{}: expected to write here, found: {source}; check free space and permissions", path.display())]
    Io { path: PathBuf, source: std::io::Error },
    /// An image cannot be encoded.
    #[error("{}: expected to write an image, found: {source}; check free space", path.display())]
    Image { path: PathBuf, source: image::ImageError },
}

pub(super) fn create_folder(path: &Path) -> Result<(), WriteError> {
    std::fs::create_dir_all(path).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

pub(super) fn create_empty_folder(path: &Path) -> Result<(), WriteError> {
    create_folder(path)?;
    let io = |source| WriteError::Io { path: path.to_owned(), source };
    match std::fs::read_dir(path).map_err(io)?.next() {
        Some(_) => Err(WriteError::NotEmpty(path.to_owned())),
        None => Ok(()),
    }
}

pub(super) fn write_jpeg(path: &Path, image: &Image<[u8; 4]>) -> Result<(), WriteError> {
    // JPEG has no alpha.
    let rgb: Vec<u8> = image.data.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let mut encoded = Vec::new();
    JpegEncoder::new_with_quality(&mut encoded, JPEG_QUALITY)
        .write_image(&rgb, image.width as u32, image.height as u32, ExtendedColorType::Rgb8)
        .map_err(|source| WriteError::Image { path: path.to_owned(), source })?;
    write_file(path, &encoded)
}

pub(super) fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), WriteError> {
    std::fs::write(path, bytes).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

/// Writes an image to a PNG file. The memory layout of its pixels must be that of `color`.
pub(super) fn write_png<P: bytemuck::Pod>(
    path: &Path,
    image: &Image<P>,
    color: ExtendedColorType,
) -> Result<(), WriteError> {
    // Encoded in memory first: the encoder writes its last chunk on drop, which would swallow the error of
    // a full disk.
    let mut encoded = Vec::new();
    PngEncoder::new(&mut encoded)
        .write_image(
            bytemuck::cast_slice(&image.data),
            image.width as u32,
            image.height as u32,
            color,
        )
        .map_err(|source| WriteError::Image { path: path.to_owned(), source })?;
    write_file(path, &encoded)
}
