//! Registry of layouts. A new layout is one file in this folder, its `mod` line and one row of the table
//! below. That file contains everything about the layout: recognition, metadata, poses, depth encoding,
//! sensor and known cameras. No other code in `dataset` depends on the layout.

mod arkit;
mod blender;
mod colmap;
mod lidar;
mod lidar_sets;
mod mcap;
mod nerfstudio;
mod numbered;
mod paired;
mod record3d;
mod recording;
mod replica;
mod rig;
mod rtabmap;
mod scanner_apps;
mod scannet;
mod seven_scenes;
mod stated;
mod stray;
mod trajectory;
mod tum;

use super::calibration::Calibration;
use super::entry::DatasetSplit;
use super::error::{DatasetError, FrameError, FrameProblem, Warning};
use super::folder::{Folder, check_count};
use super::options::LoadOptions;
use super::pose_check::PoseConvention;
use super::range::PositionRange;
use crate::math::camera::Intrinsics;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// Generates the variants of [`Layout`] and the table of their formats from one list, so that both
/// always agree.
macro_rules! layouts {
    ($($(#[$doc:meta])* $name:ident: $format:path,)*) => {
        /// Layout of a dataset's files.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, strum::IntoStaticStr)]
        #[serde(rename_all = "kebab-case")]
        #[strum(serialize_all = "kebab-case")]
        pub enum Layout {
            $($(#[$doc])* $name,)*
            /// Procedural frames rendered in memory, without files.
            Synthetic,
        }

        const FORMATS: &[(Layout, DatasetFormat)] = &[$((Layout::$name, $format),)*];
    };
}

layouts! {
    /// `transforms*.json` with one field of view, and images (NeRF-synthetic).
    Blender: blender::FORMAT,
    /// `frame-NNNNNN.{color,depth,pose}.*` (7-Scenes).
    SevenScenes: seven_scenes::FORMAT,
    /// `rgb.txt`, `depth.txt` and `groundtruth.txt` (TUM RGB-D).
    Tum: tum::FORMAT,
    /// `color/`, `depth/` and `trajectory.log` (Open3D, Redwood).
    Open3d: paired::OPEN3D,
    /// `traj.txt` and `results/` (Replica, NICE-SLAM).
    Replica: replica::FORMAT,
    /// `color/`, `depth/`, `pose/` and `intrinsic/` (ScanNet).
    Scannet: scannet::FORMAT,
    /// `transforms.json` with depth files, or a camera for each frame (nerfstudio, NeRFCapture).
    Nerfstudio: nerfstudio::FORMAT,
    /// `metadata.json`, `rgb/` and `depth/` (Record3D's export).
    Record3d: record3d::FOLDER,
    /// A zip archive `*.r3d` (Record3D).
    Record3dArchive: record3d::FORMAT,
    /// `odometry.csv`, `camera_matrix.csv`, `depth/` and a video (Stray Scanner).
    StrayScanner: stray::FORMAT,
    /// A file with one JSON object per frame (ARKit packages).
    Arkit: arkit::FORMAT,
    /// `rgb/`, `depth/`, `calib/` and poses (RTAB-Map's export).
    RtabMap: rtabmap::FORMAT,
    /// `cameras` and `images`, binary or text, beside photographs and depth (COLMAP).
    Colmap: colmap::FORMAT,
    /// `*.mcap` with images, cameras and transforms (ROS 2).
    Ros2Bag: mcap::FORMAT,
    /// `keyframes/` with `images/`, `cameras/` and `depth/` (Polycam's raw data).
    Polycam: scanner_apps::POLYCAM,
    /// `frame_N.jpg`, `frame_N.json` and `depth_N.png` (3D Scanner App).
    Scanner3d: scanner_apps::SCANNER_3D,
    /// `lowres_wide/`, `lowres_depth/` and `lowres_wide.traj` (ARKitScenes).
    ArkitScenes: lidar_sets::ARKIT_SCENES,
    /// `rgb/`, `depth/` and `pose_intrinsic_imu.json` (iPhone frames of ScanNet++).
    ScannetPp: lidar_sets::SCANNET_PP,
    /// `color/` and `depth/`, with poses of any form or, for tracking, without poses.
    ColorDepth: paired::FORMAT,
}

type Recogniser = fn(&Folder) -> Option<String>;

/// Layouts whose cameras and depth are known without the files that hold their poses.
const UNPOSED: [(Layout, Recogniser); 4] = [
    (Layout::Replica, replica::recognise_unposed),
    (Layout::Scannet, scannet::recognise_unposed),
    (Layout::StrayScanner, stray::recognise_unposed),
    (Layout::RtabMap, rtabmap::recognise_unposed),
];

pub(super) fn parse(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<(Layout, String, ParsedFolder), DatasetError> {
    let (layout, format, why) = recognise(folder, options)?;
    let parsed = (format.parse)(folder, options).and_then(|parsed| parsed.checked(&folder.path));
    // Parsing peeks at files too, and what it could not read may be what it misses.
    folder.take_unread().map_or_else(|| Ok((layout, why, parsed?)), Err)
}

/// Returns the layout of a folder, its format, and a description of the identifying files.
pub(super) fn recognise(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<(Layout, &'static DatasetFormat, String), DatasetError> {
    let recognise = |(layout, format): &'static (Layout, DatasetFormat)| {
        (format.recognise)(folder).map(|why| (*layout, format, why))
    };
    // All formats are tried: a folder of two recordings must not open as either.
    let mut found: Vec<_> = FORMATS.iter().filter_map(recognise).collect();
    // Images without any list of poses may be of a layout whose poses are missing.
    let is_plain = found.iter().all(|(layout, ..)| *layout == Layout::ColorDepth);
    let has_poses = || !found.is_empty() && !trajectory::pose_lists(folder).is_empty();
    if is_plain && (options.track || !has_poses()) {
        let unposed = UNPOSED.iter().filter_map(|(layout, recognise)| {
            let (_, format) = FORMATS.iter().find(|(other, _)| other == layout)?;
            Some((*layout, format, recognise(folder)?))
        });
        found.extend(unposed);
    }
    // A file that could not be read could have identified another layout.
    if let Some(error) = folder.take_unread() {
        return Err(error);
    }
    if found.len() > 1 {
        // A layout with poses takes precedence over images alone.
        found.retain(|(layout, ..)| *layout != Layout::ColorDepth);
    }
    if found.len() > 1 {
        // Exports of other layouts include the model that they were made from.
        found.retain(|(layout, ..)| *layout != Layout::Colmap);
    }
    if found.len() > 1 && !tum::has_two_lists(folder) {
        // Recordings of other layouts may have a list of pairs too.
        found.retain(|(layout, ..)| *layout != Layout::Tum);
    }
    if found.len() > 1 {
        let found = found.iter().map(|(layout, _, why)| format!("{} by {why}", layout.name()));
        return Err(DatasetError::TwoLayouts {
            path: folder.path.clone(),
            found: found.collect::<Vec<_>>().join("; "),
        });
    }
    if let Some(found) = found.pop() {
        return Ok(found);
    }
    if let Some(archive) = folder.opened_archive() {
        return Err(DatasetError::OtherFormat {
            path: folder.path.join(archive),
            kind: "a zip archive without photographs",
            hint: "open the folder or archive of a recording",
        });
    }
    let names: Vec<&str> = folder.listing.files().collect();
    let other = DatasetError::of_other_recording(&folder.path, &names);
    // Beside models, subfolders may hold recordings.
    let models = || DatasetError::of_models(&folder.path, &names);
    if let Some(error) = other.or_else(|| folder.subfolders().is_empty().then(models).flatten()) {
        return Err(error);
    }
    let expected: Vec<&str> = FORMATS.iter().map(|(layout, _)| layout.name()).collect();
    Err(DatasetError::NotRecognised {
        path: folder.path.clone(),
        expected: expected.join(", "),
        found: folder.listing.summary(),
    })
}

impl Layout {
    /// Returns the layout's name in reports and messages, such as `seven-scenes`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    pub(super) fn named(name: &str) -> Option<Self> {
        // Procedural frames have no format, but checkpoints name their layout too.
        let all = FORMATS.iter().map(|(layout, _)| *layout).chain([Self::Synthetic]);
        all.into_iter().find(|layout| layout.name() == name)
    }

    /// True if the layout's files state lengths in metres. Lengths of other layouts have arbitrary
    /// units.
    pub fn is_metric(self) -> bool {
        !matches!(self, Self::Blender | Self::Nerfstudio | Self::Colmap)
    }

    /// Returns the convention of the layout's pose matrices. Returns OpenCV for procedural frames,
    /// which have no matrices.
    pub fn pose_convention(self) -> PoseConvention {
        let format = FORMATS.iter().find(|(layout, _)| *layout == self);
        format.map_or(PoseConvention::Opencv, |(_, format)| format.poses)
    }

    pub(super) fn known_calibration(self, depth_camera: &Intrinsics) -> Option<Calibration> {
        match self {
            // Other layouts state their cameras, or have a single lens.
            Self::SevenScenes => seven_scenes::known_calibration(depth_camera),
            _ => None,
        }
    }
}

pub(in crate::dataset) struct DatasetFormat {
    pub poses: PoseConvention,
    /// Returns a description of the identifying files if the folder has this layout, else `None`.
    /// Unknown content must not cause an error.
    pub recognise: fn(&Folder) -> Option<String>,
    pub parse: fn(&Folder, &LoadOptions) -> Result<ParsedFolder, DatasetError>,
}

#[derive(Default)]
pub(super) struct ParsedFolder {
    /// Splits of the dataset. The caller drops empty splits.
    pub splits: Vec<DatasetSplit>,
    pub warnings: Vec<Warning>,
    pub notes: Vec<String>,
    /// Statements of the files that are not used, each with its file and the reason, and other defects that
    /// cost no frame.
    pub unused: Vec<String>,
    pub known_range: Option<PositionRange>,
    /// Number of frames and skipped frames that are left out because there are [`MAX_FRAMES`] without them.
    pub overflow: usize,
}

/// Largest number of frames of a recording, and of its skipped frames, whose entries take a kilobyte each: more
/// than an hour at 30 Hz.
pub(super) const MAX_FRAMES: usize = 120_000;

impl ParsedFolder {
    fn checked(self, folder: &Path) -> Result<Self, DatasetError> {
        check_count(folder, "frames", MAX_FRAMES + self.overflow, MAX_FRAMES).map(|()| self)
    }

    pub fn append(&mut self, other: Self) {
        self.splits.extend(other.splits);
        self.warnings.extend(other.warnings);
        self.notes.extend(other.notes);
        self.unused.extend(other.unused);
        self.overflow += other.overflow;
    }

    pub fn skip(&mut self, split: &str, frame: &str, file: PathBuf, problem: FrameProblem) {
        if self.warnings.len() == MAX_FRAMES {
            self.overflow += 1;
            return;
        }
        let error = Arc::new(FrameError { file, frame: frame.to_owned(), problem });
        self.warnings.push(Warning { split: split.to_owned(), error });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checkpoints and reports contain the names tested here.
    #[test]
    fn names_are_those_of_files() {
        let names = "blender seven-scenes tum open3d replica scannet nerfstudio record3d \
                     record3d-archive stray-scanner arkit rtab-map colmap ros2-bag polycam \
                     scanner3d arkit-scenes scannet-pp color-depth synthetic";
        let layouts = FORMATS.iter().map(|(layout, _)| *layout).chain([Layout::Synthetic]);
        let found = layouts.map(|layout| {
            assert_eq!(serde_json::to_value(layout).unwrap(), layout.name());
            layout.name()
        });
        assert_eq!(found.collect::<Vec<_>>().join(" "), names);
    }
}
