//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod blender;
mod files;
mod live;
mod sequences;

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::ViewPlan;
use files::create_empty_folder;
use std::path::Path;
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantNames};

pub use blender::DepthBits;
pub use files::WriteError;
pub use live::LiveFiles;

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
        SyntheticLayout::Blender(bits) => blender::write(&plan, |_| true, out, bits, &mut count),
        SyntheticLayout::SevenScenes => sequences::write_seven_scenes(&plan, out, &mut count),
        SyntheticLayout::Tum => sequences::write_tum(&plan, out, &mut count),
        SyntheticLayout::Record3d => sequences::write_record3d(&plan, out, &mut count),
    }?;
    let has_splits = matches!(layout, SyntheticLayout::Blender(_) | SyntheticLayout::SevenScenes);
    if has_splits || !plan.has_unrecorded_splits() {
        return Ok(());
    }
    // 16 bits, because these views serve as ground truth.
    let (beside, bits) = (out.join(FREE_FOLDER), DepthBits::Sixteen);
    blender::write(&plan, |split| !split.is_recorded, &beside, bits, &mut count)
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
