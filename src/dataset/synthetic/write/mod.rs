//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod layouts;
mod live;

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::ViewPlan;
use crate::math::image::Image;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::PngEncoder;
use image::{ExtendedColorType, ImageEncoder};
use layouts::{write_blender, write_record3d, write_seven_scenes, write_tum};
use std::path::{Path, PathBuf};
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantNames};

pub use layouts::DepthBits;
pub use live::LiveFiles;

const JPEG_QUALITY: u8 = 95;

/// Subfolder for splits that layouts without splits cannot contain. It has the Blender layout with
/// 16-bit depth, and true poses in the world frame of the recording.
pub const FREE_FOLDER: &str = "free";

/// Renders all frames of `params` into the new or empty folder `out`, with depth and poses. `on_frame`
/// receives the number of frames written and the total.
///
/// # Errors
/// Fails for parameters outside their range, or for a layout that the camera does not support. Also
/// fails if the folder is not empty or files cannot be written.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    if params.camera != SyntheticCamera::Room && layout != SyntheticLayout::Record3d {
        let found = <&str>::from(layout).to_owned();
        let expected = "record3d for the phone";
        return Err(ParamsError { setting: "layout", expected, found }.into());
    }
    let plan = ViewPlan::new(params)?;
    // Created before rendering, so that recordings are never mixed.
    create_empty_folder(out)?;
    let total = plan.splits.iter().map(|split| split.poses.len()).sum();
    let mut done = 0;
    let mut count = || {
        done += 1;
        on_frame(done, total);
    };
    match layout {
        SyntheticLayout::Blender(bits) => write_blender(&plan, |_| true, out, bits, &mut count),
        SyntheticLayout::SevenScenes => write_seven_scenes(&plan, out, &mut count),
        SyntheticLayout::Tum => write_tum(&plan, out, &mut count),
        SyntheticLayout::Record3d => write_record3d(&plan, out, &mut count),
    }?;
    let has_splits = matches!(layout, SyntheticLayout::Blender(_) | SyntheticLayout::SevenScenes);
    if has_splits || !plan.has_unrecorded_splits() {
        return Ok(());
    }
    // 16 bits, because these views serve as ground truth.
    let (beside, bits) = (out.join(FREE_FOLDER), DepthBits::Sixteen);
    write_blender(&plan, |split| !split.is_recorded, &beside, bits, &mut count)
}

/// Writes the dataset of [`write()`] as a growing recording. Images are written in two parts, list lines
/// after their images, and the end marker last. Before each frame, `due` receives the frame's index from
/// 0 and the total, and blocks until the frame is due. Rendering is slower than a camera, so everything
/// is first rendered to a temporary folder next to `out`.
///
/// # Errors
/// Fails for a layout that stores its frames in one file, and in the cases of [`write()`].
pub fn write_live(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    due: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let places = LiveFiles::of(layout)?;
    create_empty_folder(out)?;
    let io = |source| WriteError::Io { path: out.to_owned(), source };
    // The parent of a bare name is empty.
    let beside = std::path::absolute(out).map_err(io)?;
    let beside = beside.parent().unwrap_or(&beside);
    let finished = tempfile::Builder::new().prefix(".live").tempdir_in(beside).map_err(io)?;
    write(params, finished.path(), layout, &mut |_, _| ())?;
    places.replay(finished.path(), out, due)
}

/// Folder layout to write. In layouts without splits, the evaluation frames of the room's camera follow the
/// training frames. Free frames and the phone's evaluation frames go to the folder [`FREE_FOLDER`].
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, EnumMessage, EnumString, IntoStaticStr, VariantNames,
)]
#[strum(serialize_all = "kebab-case")]
pub enum SyntheticLayout {
    /// NeRF-synthetic, with depth along the ray.
    Blender(DepthBits),
    /// 7-Scenes: depth along the optical axis, millimetres.
    SevenScenes,
    /// TUM RGB-D: lists sorted by time, depth in 1/5000 m.
    Tum,
    /// Record3D's exported folder: JPEG, depth as half-float EXR at a quarter of the resolution, metres.
    Record3d,
}

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

fn create_folder(path: &Path) -> Result<(), WriteError> {
    std::fs::create_dir_all(path).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

fn create_empty_folder(path: &Path) -> Result<(), WriteError> {
    create_folder(path)?;
    let io = |source| WriteError::Io { path: path.to_owned(), source };
    match std::fs::read_dir(path).map_err(io)?.next() {
        Some(_) => Err(WriteError::NotEmpty(path.to_owned())),
        None => Ok(()),
    }
}

fn write_jpeg(path: &Path, image: &Image<[u8; 4]>) -> Result<(), WriteError> {
    // JPEG has no alpha.
    let rgb: Vec<u8> = image.data.iter().flat_map(|[r, g, b, _]| [*r, *g, *b]).collect();
    let mut encoded = Vec::new();
    JpegEncoder::new_with_quality(&mut encoded, JPEG_QUALITY)
        .write_image(&rgb, image.width as u32, image.height as u32, ExtendedColorType::Rgb8)
        .map_err(|source| WriteError::Image { path: path.to_owned(), source })?;
    write_file(path, &encoded)
}

fn write_file(path: &Path, bytes: impl AsRef<[u8]>) -> Result<(), WriteError> {
    std::fs::write(path, bytes).map_err(|source| WriteError::Io { path: path.to_owned(), source })
}

/// Writes an image to a PNG file. The memory layout of its pixels must be that of `color`.
fn write_png<P: bytemuck::Pod>(
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
