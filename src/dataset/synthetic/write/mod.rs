//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod arkit;
mod blender;
mod files;
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

use super::params::SyntheticParams;
use super::plan::ViewPlan;
use files::create_folder;
use std::path::Path;

/// Folder layout to write. Layouts that know no splits hold the evaluation frames behind the training
/// frames.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticLayout {
    /// NeRF-synthetic, with depth along the ray.
    Blender(DepthBits),
    /// 7-Scenes: millimetres along the optical axis.
    SevenScenes,
    /// TUM RGB-D: lists by time, 1/5000 m.
    Tum,
    /// Open3D: `trajectory.log`, millimetres.
    Open3d,
    /// Replica as NICE-SLAM rendered it: JPEG, 1/6553.5 m.
    Replica,
    /// ScanNet's export: JPEG, depth by a camera of half the size, millimetres.
    Scannet,
    /// nerfstudio with depth, millimetres.
    Nerfstudio,
    /// Record3D's exported folder: JPEG, EXR of half floats of a quarter of the size, metres.
    Record3d,
    /// Record3D's archive: JPEG, packed floats of a quarter of the size, metres.
    Record3dArchive,
    /// Stray Scanner with unpacked images: depth of a quarter of the size, millimetres.
    StrayScanner,
    /// An ARKit package: bare floats of a quarter of the size, metres.
    Arkit,
    /// RTAB-Map's export, millimetres.
    RtabMap,
}

/// Renders all frames of `params` into the new or empty folder `out`, with depth and poses in every
/// split. `on_frame` hears how many frames of how many are written.
pub fn write(
    params: &SyntheticParams,
    out: &Path,
    layout: SyntheticLayout,
    on_frame: &mut dyn FnMut(usize, usize),
) -> Result<(), WriteError> {
    let plan = ViewPlan::new(params)?;
    create_folder(out)?;
    // Before anything is rendered, so that no recording is mixed with another.
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
    }
}
