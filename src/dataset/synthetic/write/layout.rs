//! Layouts in which the synthetic scene can be written.

use super::blender::DepthBits;

/// Folder layout to write. In layouts without splits, the evaluation frames of the room's camera follow the
/// training frames. Free frames and the phone's evaluation frames go to the folder [`super::FREE_FOLDER`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
    pub(super) fn has_splits(self) -> bool {
        matches!(self, Self::Blender(_) | Self::SevenScenes)
    }

    /// True for layouts of phone apps: photographs, depth of lower resolution and its confidence.
    pub(super) fn is_phone_layout(self) -> bool {
        matches!(self, Self::Record3d | Self::Record3dArchive | Self::StrayScanner | Self::Arkit)
    }
}
