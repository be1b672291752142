//! The registry of layouts. A new layout is one file in this folder, its `mod` line and one row of
//! the table below: recognition, metadata, poses, depth encoding, sensor and what is known of its
//! cameras all stand in that file, and nothing else in `dataset` asks which layout it reads.

mod arkit;
mod blender;
mod color_depth;
mod format;
mod lens;
mod listed;
mod majority;
mod nerfstudio;
mod numbered;
mod open3d;
mod paired;
mod record3d;
mod record3d_archive;
mod record3d_folder;
mod recording;
mod replica;
mod rig;
mod rtabmap;
mod scannet;
mod seven_scenes;
mod stated;
mod stray;
mod trajectory;
mod tum;

use super::calibration::Calibration;
use super::error::DatasetError;
use super::folder::Folder;
use super::options::LoadOptions;
use super::pose_convention::PoseConvention;
use crate::math::camera::Intrinsics;
use format::DatasetFormat;
pub(super) use format::ParsedFolder;

/// Makes both the variants of [`Layout`] and the table of their formats from one list of rows, so
/// that neither can lack what the other has.
macro_rules! layouts {
    ($($(#[$doc:meta])* $name:ident: $format:path,)*) => {
        /// Layout of a dataset's files.
        #[derive(Clone, Copy, Debug, PartialEq, Eq, serde::Serialize, strum::IntoStaticStr)]
        #[serde(rename_all = "kebab-case")]
        #[strum(serialize_all = "kebab-case")]
        pub enum Layout {
            $($(#[$doc])* $name,)*
            /// Frames made on demand; no files.
            Synthetic,
        }

        /// In order of trial.
        const FORMATS: &[(Layout, DatasetFormat)] = &[$((Layout::$name, $format),)*];
    };
}

layouts! {
    /// `transforms*.json` with one field of view, images beside it (NeRF-synthetic).
    Blender: blender::FORMAT,
    /// `frame-NNNNNN.{color,depth,pose}.*` (7-Scenes).
    SevenScenes: seven_scenes::FORMAT,
    /// `rgb.txt`, `depth.txt` and `groundtruth.txt` (TUM RGB-D).
    Tum: tum::FORMAT,
    /// `color/`, `depth/` and `trajectory.log` (Open3D, Redwood).
    Open3d: open3d::FORMAT,
    /// `traj.txt` and `results/` (Replica, NICE-SLAM).
    Replica: replica::FORMAT,
    /// `color/`, `depth/`, `pose/` and `intrinsic/` (ScanNet).
    Scannet: scannet::FORMAT,
    /// `transforms.json` with depth files, or a camera for each frame (nerfstudio, NeRFCapture).
    Nerfstudio: nerfstudio::FORMAT,
    /// `metadata.json`, `rgb/` and `depth/` (Record3D's export).
    Record3d: record3d_folder::FORMAT,
    /// A zip archive `*.r3d` (Record3D).
    Record3dArchive: record3d_archive::FORMAT,
    /// `odometry.csv`, `camera_matrix.csv`, `depth/` and a video (Stray Scanner).
    StrayScanner: stray::FORMAT,
    /// A file of one JSON object a frame (ARKit packages).
    Arkit: arkit::FORMAT,
    /// `rgb/`, `depth/`, `calib/` and poses (RTAB-Map's export).
    RtabMap: rtabmap::FORMAT,
    /// `color/` and `depth/` without poses, for tracking.
    ColorDepth: color_depth::FORMAT,
}

/// Recognises the layout and reads it; with the content that it was recognised by.
pub(super) fn parse(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<(Layout, String, ParsedFolder), DatasetError> {
    let recognise = |(layout, format): &'static (Layout, DatasetFormat)| {
        (format.recognise)(folder).map(|why| (*layout, format, why))
    };
    let mut found: Vec<_> = FORMATS.iter().filter_map(recognise).collect();
    if let Some(error) = folder.unread() {
        return Err(error);
    }
    if found.len() > 1 {
        // Whatever knows of poses knows more.
        found.retain(|(layout, ..)| *layout != Layout::ColorDepth);
    }
    if found.len() > 1 {
        let found = found.iter().map(|(layout, _, why)| format!("{} by {why}", layout.name()));
        return Err(DatasetError::TwoLayouts {
            path: folder.path.clone(),
            found: found.collect::<Vec<_>>().join("; "),
        });
    }
    if let Some((layout, format, why)) = found.pop() {
        let parsed = (format.parse)(folder, options)?;
        // They are told apart by what was asked again.
        return folder.unread().map_or(Ok((layout, why, parsed)), Err);
    }
    let expected: Vec<&str> = FORMATS.iter().map(|(_, format)| format.looks_for).collect();
    Err(DatasetError::NotRecognised {
        path: folder.path.clone(),
        expected: expected.join("; "),
        found: folder.listing.summary(),
    })
}

impl Layout {
    /// The name that reports and messages give it, such as `seven-scenes`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// The layout of that name.
    pub(super) fn named(name: &str) -> Option<Self> {
        let all = FORMATS.iter().map(|(layout, _)| *layout).chain([Self::Synthetic]);
        all.into_iter().find(|layout| layout.name() == name)
    }

    /// Whether its files state lengths in metres; the others' worlds have any unit.
    pub fn is_metric(self) -> bool {
        !matches!(self, Self::Blender | Self::Nerfstudio)
    }

    /// What its pose matrices mean; frames made on demand have none.
    pub fn pose_convention(self) -> PoseConvention {
        let format = FORMATS.iter().find(|(layout, _)| *layout == self);
        format.map_or(PoseConvention::Opencv, |(_, format)| format.poses)
    }

    /// What is known, without a calibration, of cameras whose depth has these intrinsics.
    pub(super) fn known_calibration(self, depth_camera: &Intrinsics) -> Option<Calibration> {
        let (_, format) = FORMATS.iter().find(|(layout, _)| *layout == self)?;
        (format.known_calibration)(depth_camera)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Checkpoints and reports hold these names.
    #[test]
    fn names_are_those_of_files() {
        let named = [
            (Layout::Blender, "blender"),
            (Layout::SevenScenes, "seven-scenes"),
            (Layout::Tum, "tum"),
            (Layout::Open3d, "open3d"),
            (Layout::Replica, "replica"),
            (Layout::Scannet, "scannet"),
            (Layout::Nerfstudio, "nerfstudio"),
            (Layout::Record3d, "record3d"),
            (Layout::Record3dArchive, "record3d-archive"),
            (Layout::StrayScanner, "stray-scanner"),
            (Layout::Arkit, "arkit"),
            (Layout::RtabMap, "rtab-map"),
            (Layout::ColorDepth, "color-depth"),
            (Layout::Synthetic, "synthetic"),
        ];
        for (layout, name) in named {
            assert_eq!(layout.name(), name);
            assert_eq!(serde_json::to_value(layout).unwrap(), name);
        }
    }
}
