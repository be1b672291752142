//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod arkit;
mod blender;
mod files;
mod layout;
mod live;
mod nerfstudio;
mod open3d;
mod record3d;
mod replica;
mod rtabmap;
mod scannet;
mod sequence;
mod seven_scenes;
mod stray;
mod tum;

pub use blender::DepthBits;
pub use files::WriteError;
pub use layout::SyntheticLayout;

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::ViewPlan;
use files::create_empty_folder;
use live::LiveLayout;
use std::path::Path;

/// Sub-folder, in layouts without splits, for the remaining splits: in the Blender layout with 16-bit
/// depth, with true poses in the world frame of the recording.
pub const FREE_FOLDER: &str = "free";

/// Renders all frames of `params` into the new or empty folder `out`, with depth and poses in every split.
/// `on_frame` receives the number of frames written and the total.
///
/// # Errors
/// Parameters outside their range, a layout that the camera does not support, a folder that is not empty,
/// or files that cannot be written.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    check_camera(params, layout)?;
    let plan = ViewPlan::new(params)?;
    // Before rendering, so that recordings are never mixed.
    create_empty_folder(out)?;
    let total = plan.splits.iter().map(|split| split.poses.len()).sum();
    let mut done = 0;
    let mut count = || {
        done += 1;
        on_frame(done, total);
    };
    match layout {
        SyntheticLayout::Blender(bits) => blender::write(&plan, out, bits, &mut count),
        SyntheticLayout::SevenScenes => seven_scenes::write(&plan, out, &mut count),
        SyntheticLayout::Tum => tum::write(&plan, out, &mut count),
        SyntheticLayout::Open3d => open3d::write(&plan, out, &mut count),
        SyntheticLayout::Replica => replica::write(&plan, out, &mut count),
        SyntheticLayout::Scannet => scannet::write(&plan, out, &mut count),
        SyntheticLayout::Nerfstudio => nerfstudio::write(&plan, out, &mut count),
        SyntheticLayout::Record3d => record3d::write_folder(&plan, out, &mut count),
        SyntheticLayout::Record3dArchive => record3d::write_archive(&plan, out, &mut count),
        SyntheticLayout::StrayScanner => stray::write(&plan, out, &mut count),
        SyntheticLayout::Arkit => arkit::write(&plan, out, &mut count),
        SyntheticLayout::RtabMap => rtabmap::write(&plan, out, &mut count),
    }?;
    if layout.has_splits() || plan.splits.iter().all(|split| split.is_recorded) {
        return Ok(());
    }
    let (beside, bits) = (out.join(FREE_FOLDER), DepthBits::Sixteen);
    blender::write_splits(&plan, |split| !split.is_recorded, &beside, bits, &mut count)
}

fn check_camera(params: &SyntheticParams, layout: SyntheticLayout) -> Result<(), ParamsError> {
    if params.camera == SyntheticCamera::Room || layout.is_phone_layout() {
        return Ok(());
    }
    Err(ParamsError {
        setting: "layout",
        expected: "record3d, record3d-archive, stray-scanner or arkit for the phone",
        found: format!("{layout:?}"),
    })
}

/// Writes the dataset of [`write()`] as a growing recording. Images are written in two parts, list lines
/// after their images, and the end marker last. `due` is called before each frame with its index from 0 and
/// the total, and blocks until the frame is due. Rendering is slower than a camera, so everything is first
/// rendered to a temporary folder next to `out`.
///
/// # Errors
/// A layout that stores its frames in one file; otherwise as [`write()`].
pub fn write_live(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    due: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let places = LiveLayout::of(layout)?;
    create_empty_folder(out)?;
    let io = |source| WriteError::Io { path: out.to_owned(), source };
    let beside = std::path::absolute(out).map_err(io)?;
    let beside = beside.parent().unwrap_or(&beside);
    let finished = tempfile::Builder::new().prefix(".live").tempdir_in(beside).map_err(io)?;
    write(params, finished.path(), layout, &mut |_, _| ())?;
    places.replay(finished.path(), out, due)
}
