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
use live::FramePlaces;
use std::path::Path;

/// Sub-folder of a recording in a layout without splits: the splits that it does not hold, in the
/// Blender layout with 16-bit depth, with true poses in the world of the recording.
pub const FREE_FOLDER: &str = "free";

/// Renders all frames of `params` into the new or empty folder `out`, with depth and poses in every
/// split. `on_frame` gets the numbers of frames written and of all frames.
///
/// # Errors
/// Parameters outside their range, a layout that the camera does not record in, a folder that is not
/// empty, and files that cannot be written.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    check_camera(params, layout)?;
    let plan = ViewPlan::new(params)?;
    // Before anything is rendered, so that no recording is mixed with another.
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
    if params.camera == SyntheticCamera::Room || layout.is_of_phones() {
        return Ok(());
    }
    Err(ParamsError {
        setting: "layout",
        expected: "record3d, record3d-archive, stray-scanner or arkit beside the phone",
        found: format!("{layout:?}"),
    })
}

/// Writes what [`write()`] does as a recording that grows, images in two parts, lines behind their images
/// and the marker of the end last: `due` is called before each frame, with its number from 0 and that
/// of all, and returns when it is time. Rendering is slower than a camera, so that everything is
/// written to a folder beside first.
///
/// # Errors
/// A layout that has its frames in one file; otherwise as [`write()`].
pub fn write_live(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    due: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let places = FramePlaces::of(layout)?;
    create_empty_folder(out)?;
    let io = |source| WriteError::Io { path: out.to_owned(), source };
    let beside = std::path::absolute(out).map_err(io)?;
    let beside = beside.parent().unwrap_or(&beside);
    let finished = tempfile::Builder::new().prefix(".live").tempdir_in(beside).map_err(io)?;
    write(params, finished.path(), layout, &mut |_, _| ())?;
    places.play(finished.path(), out, due)
}
