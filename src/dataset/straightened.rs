//! Images of frames whose poses are left to tracking, straightened by those that were recorded.
//!
//! Rows that were read one after the other, and photographs taken before or after depth, are put right by the
//! trajectory of a recording. Tracking knows none, and learns from images as they are. But what is measured
//! should not depend on who placed the cameras: views of both are compared with the same photographs.

use super::entry::{FrameEntry, FrameSource};
use super::opened::{Dataset, open};
use super::options::LoadOptions;
use std::collections::BTreeMap;

impl Dataset {
    /// The same recording with the poses that were recorded; `None` where it cannot be opened with them.
    pub fn recorded(&self) -> Option<Self> {
        let options = LoadOptions { track: false, ..self.options };
        open(self.path.as_ref()?, &options).ok()
    }

    /// The same frames with the images that they have where their poses are the recorded ones; `None` where
    /// these are no others. Poses stay as they are.
    pub fn straightened(&self) -> Option<Self> {
        let recorded = self.options.track.then(|| self.recorded()).flatten()?;
        let entries = recorded.splits.iter().flat_map(|split| &split.frames);
        let recorded: BTreeMap<&str, &FrameEntry> =
            entries.map(|entry| (entry.name.as_str(), entry)).collect();
        let mut straightened = self.clone();
        let mut changes = false;
        for entry in straightened.splits.iter_mut().flat_map(|split| &mut split.frames) {
            if let Some(other) = recorded.get(entry.name.as_str()) {
                changes |= entry.take_images(other);
            }
        }
        changes.then_some(straightened)
    }
}

impl FrameEntry {
    /// Takes the images of another entry of the same frame; whether they are others.
    fn take_images(&mut self, other: &Self) -> bool {
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
