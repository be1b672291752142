//! The registry of layouts. A new layout is one file in this folder, its `mod` line and one row of
//! the table below: recognition, metadata, poses, depth encoding, sensor and what is known of its
//! cameras all stand in that file, and nothing else in `dataset` asks which layout it reads.

mod blender;
mod format;
mod listed;
mod seven_scenes;

use super::calibration::Calibration;
use super::error::DatasetError;
use super::folder::Folder;
use super::options::LoadOptions;
use crate::math::camera::Intrinsics;
use format::{DatasetFormat, ParsedFolder};

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
}

/// Recognises the layout and reads it; with the content that it was recognised by.
pub(super) fn parse(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<(Layout, String, ParsedFolder), DatasetError> {
    for (layout, format) in FORMATS {
        if let Some(why) = (format.recognise)(folder) {
            return Ok((*layout, why, (format.parse)(folder, options)?));
        }
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
        let names = ["blender", "seven-scenes", "synthetic"];
        for (layout, name) in
            [Layout::Blender, Layout::SevenScenes, Layout::Synthetic].iter().zip(names)
        {
            assert_eq!(layout.name(), name);
            assert_eq!(serde_json::to_value(layout).unwrap(), name);
        }
    }
}
