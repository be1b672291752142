//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

use super::{ParamsError, Plan, SyntheticParams, write_blender, write_seven_scenes};
use crate::math::image::Image;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use std::io::BufWriter;
use std::path::{Path, PathBuf};

/// Folder layout to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticLayout {
    /// NeRF-synthetic, with depth along the ray.
    Blender(DepthBits),
    /// 7-Scenes: millimetres along the optical axis.
    SevenScenes,
}

/// How the Blender layout stores depth.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DepthBits {
    /// `8·(1 − d/255)` in RGBA, steps of 31 mm, as the classic export.
    Eight,
    /// Gray steps of `integer_depth_scale` = 0.25 mm.
    Sixteen,
}

/// Why a dataset cannot be written.
#[derive(Debug, thiserror::Error)]
pub enum WriteError {
    /// Parameters outside their range.
    #[error("{0}")]
    Params(#[from] ParamsError),
    /// Nothing is overwritten.
    #[error(
        "{}: expected a new or empty folder, found one with files; choose another", .0.display()
    )]
    NotEmpty(PathBuf),
    /// A folder or file that cannot be written.
    #[error("{}: expected to write here, found: {source}; check free space and permissions", path.display())]
    Io {
        /// The folder or file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// An image that cannot be encoded.
    #[error("{}: expected to write an image, found: {source}; check free space", path.display())]
    Image {
        /// The file.
        path: PathBuf,
        /// What the encoder said.
        source: image::ImageError,
    },
}

/// Renders all frames of `params` into the new or empty folder `out`, with depth and poses in every
/// split. `on_frame` hears how many frames of how many are written.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let plan = Plan::new(params)?;
    create_folder(out)?;
    let mut entries =
        std::fs::read_dir(out).map_err(|source| WriteError::Io { path: out.to_owned(), source })?;
    if entries.next().is_some() {
        return Err(WriteError::NotEmpty(out.to_owned()));
    }
    let total = plan.splits.iter().map(|split| split.poses.len()).sum();
    let mut done = 0;
    let mut count = || {
        done += 1;
        on_frame(done, total);
    };
    match layout {
        SyntheticLayout::Blender(bits) => write_blender::write(&plan, out, bits, &mut count),
        SyntheticLayout::SevenScenes => write_seven_scenes::write(&plan, out, &mut count),
    }
}

pub(super) fn create_folder(path: &Path) -> Result<(), WriteError> {
    std::fs::create_dir_all(path).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

pub(super) fn write_text(path: &Path, text: &str) -> Result<(), WriteError> {
    std::fs::write(path, text).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

/// RGBA PNG.
pub(super) fn write_rgba(path: &Path, image: &Image<[u8; 4]>) -> Result<(), WriteError> {
    let size = (image.width, image.height);
    write_png(path, image.data.as_flattened(), size, ExtendedColorType::Rgba8)
}

/// 16-bit gray PNG.
pub(super) fn write_gray16(path: &Path, image: &Image<u16>) -> Result<(), WriteError> {
    let bytes = bytemuck::cast_slice(&image.data);
    write_png(path, bytes, (image.width, image.height), ExtendedColorType::L16)
}

fn write_png(
    path: &Path,
    bytes: &[u8],
    (width, height): (usize, usize),
    color: ExtendedColorType,
) -> Result<(), WriteError> {
    let file = std::fs::File::create(path)
        .map_err(|source| WriteError::Io { path: path.to_owned(), source })?;
    PngEncoder::new(BufWriter::new(file))
        .write_image(bytes, width as u32, height as u32, color)
        .map_err(|source| WriteError::Image { path: path.to_owned(), source })
}
