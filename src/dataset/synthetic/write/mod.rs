//! Writes the synthetic scene as a dataset folder, in the layouts that the loaders read.

mod blender;
mod files;
mod live;
mod nerfstudio;
mod record3d;
mod scannet;
mod tum;

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::ViewPlan;
use files::create_empty_folder;
use live::LiveLayout;
use std::path::Path;
use strum::{EnumMessage, EnumString, IntoStaticStr, VariantNames};

pub use blender::DepthBits;
pub use files::WriteError;

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
        SyntheticLayout::SevenScenes => scannet::write_seven_scenes(&plan, out, &mut count),
        SyntheticLayout::Tum => tum::write(&plan, out, &mut count),
        SyntheticLayout::Open3d => tum::write_open3d(&plan, out, &mut count),
        SyntheticLayout::Replica => scannet::write_replica(&plan, out, &mut count),
        SyntheticLayout::Scannet => scannet::write(&plan, out, &mut count),
        SyntheticLayout::Nerfstudio => nerfstudio::write(&plan, out, &mut count),
        SyntheticLayout::Record3d => record3d::write_folder(&plan, out, &mut count),
        SyntheticLayout::Record3dArchive => record3d::write_archive(&plan, out, &mut count),
        SyntheticLayout::StrayScanner => record3d::write_stray(&plan, out, &mut count),
        SyntheticLayout::Arkit => record3d::write(&plan, out, &mut count),
        SyntheticLayout::RtabMap => tum::write_rtabmap(&plan, out, &mut count),
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
        found: <&str>::from(layout).to_owned(),
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
    /// Open3D: `trajectory.log`, depth in millimetres.
    Open3d,
    /// Replica as rendered by NICE-SLAM: JPEG, depth in 1/6553.5 m.
    Replica,
    /// ScanNet export: JPEG, depth at half resolution in millimetres.
    Scannet,
    /// nerfstudio with depth in millimetres.
    Nerfstudio,
    /// Record3D's exported folder: JPEG, depth as half-float EXR at a quarter of the resolution, metres.
    Record3d,
    /// Record3D's archive: JPEG, compressed float depth at a quarter of the resolution, metres.
    Record3dArchive,
    /// Stray Scanner with extracted images: depth at a quarter of the resolution, millimetres.
    StrayScanner,
    /// ARKit package: raw float depth at a quarter of the resolution, metres.
    Arkit,
    /// RTAB-Map export, depth in millimetres.
    RtabMap,
}

impl SyntheticLayout {
    /// All layouts, Blender with both depth encodings.
    pub const ALL: [Self; 13] = [
        Self::Blender(DepthBits::Eight),
        Self::Blender(DepthBits::Sixteen),
        Self::SevenScenes,
        Self::Tum,
        Self::Open3d,
        Self::Replica,
        Self::Scannet,
        Self::Nerfstudio,
        Self::Record3d,
        Self::Record3dArchive,
        Self::StrayScanner,
        Self::Arkit,
        Self::RtabMap,
    ];

    /// True if the layout has a folder or list per split.
    fn has_splits(self) -> bool {
        matches!(self, Self::Blender(_) | Self::SevenScenes)
    }

    /// True for layouts of phone apps: photographs, depth of lower resolution and its confidence.
    fn is_phone_layout(self) -> bool {
        matches!(self, Self::Record3d | Self::Record3dArchive | Self::StrayScanner | Self::Arkit)
    }
}
