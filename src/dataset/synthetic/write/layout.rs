//! The layouts that the synthetic scene is written in.

use super::blender::DepthBits;

/// Folder layout to write. Layouts without splits hold the evaluation frames of the room's camera
/// behind the training frames; free frames, and the phone's evaluation frames, are in the folder
/// [`super::FREE_FOLDER`].
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

impl SyntheticLayout {
    /// Each of them; Blender's by both depths.
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

    /// Whether the layout has a folder or list for each split.
    pub(super) fn has_splits(self) -> bool {
        matches!(self, Self::Blender(_) | Self::SevenScenes)
    }

    /// Whether a phone records in it: photographs, smaller depth and its confidence.
    pub(super) fn is_of_phones(self) -> bool {
        matches!(self, Self::Record3d | Self::Record3dArchive | Self::StrayScanner | Self::Arkit)
    }
}
