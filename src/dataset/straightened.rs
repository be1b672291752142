//! Rectified images for frames whose poses are left to tracking.
//!
//! Rolling shutter and the time offset between photograph and depth are corrected by the recorded
//! trajectory. Tracking has none and is trained on the images as they are. Evaluation must not depend on
//! the source of the poses: tracked and recorded cameras are compared with the same, rectified photographs.

use super::entry::{FrameEntry, FrameSource};
use super::opened::{Dataset, open};
use super::options::LoadOptions;
use std::collections::BTreeMap;

impl Dataset {
    /// Reopens the recording with its recorded poses; `None` if that fails.
    pub fn with_recorded_poses(&self) -> Option<Self> {
        let options = LoadOptions { track: false, ..self.options };
        open(self.path.as_ref()?, &options).ok()
    }

    /// Replaces the images by those rectified with the recorded poses; `None` if nothing changes. Poses are
    /// unchanged.
    pub fn rectified(&self) -> Option<Self> {
        let recorded = self.options.track.then(|| self.with_recorded_poses()).flatten()?;
        let entries = recorded.splits.iter().flat_map(|split| &split.frames);
        let recorded: BTreeMap<&str, &FrameEntry> =
            entries.map(|entry| (entry.name.as_str(), entry)).collect();
        let mut straightened = self.clone();
        let mut changes = false;
        for entry in straightened.splits.iter_mut().flat_map(|split| &mut split.frames) {
            if let Some(other) = recorded.get(entry.name.as_str()) {
                changes |= entry.replace_images(other);
            }
        }
        changes.then_some(straightened)
    }
}

impl FrameEntry {
    /// Takes the images of another entry of the same frame; true if they differ.
    fn replace_images(&mut self, other: &Self) -> bool {
        let lens = |entry: &Self| match &entry.source {
            FrameSource::Files(files) => Some(files.lens),
            FrameSource::Synthetic { .. } => None,
        };
        let changes = (lens(self), &self.color_camera) != (lens(other), &other.color_camera);
        self.source = other.source.clone();
        self.color_camera.clone_from(&other.color_camera);
        changes
    }
}
