//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod blender;
mod files;
mod seven_scenes;

pub use blender::DepthBits;
pub use files::WriteError;

use super::params::SyntheticParams;
use super::plan::ViewPlan;
use files::create_folder;
use std::path::Path;

/// Folder layout to write.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SyntheticLayout {
    /// NeRF-synthetic, with depth along the ray.
    Blender(DepthBits),
    /// 7-Scenes: millimetres along the optical axis.
    SevenScenes,
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
    }
}
