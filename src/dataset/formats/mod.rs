//! The table of layouts: how each is recognised and read. A new layout is one file and one row.

mod blender;
mod candidate;
pub mod seven_scenes;

use super::error::{DatasetError, FrameError, FrameProblem};
use super::folder::Folder;
use super::range::PositionRange;
use super::{Layout, LoadOptions, Split, Warning};
use crate::math::camera::Intrinsics;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// One layout.
pub(super) struct Format {
    pub layout: Layout,
    /// What it is recognised by, for messages.
    pub looks_for: &'static str,
    /// What was found, if this is the layout. Must not fail on anything it does not know.
    pub recognise: fn(&Folder) -> Option<String>,
    /// Reads metadata and poses.
    pub parse: fn(&Folder, &LoadOptions) -> Result<Parsed, DatasetError>,
}

/// What a layout's files say.
#[derive(Default)]
pub(super) struct Parsed {
    /// May be empty; the caller drops such splits.
    pub splits: Vec<Split>,
    pub warnings: Vec<Warning>,
    pub notes: Vec<String>,
    pub known_range: Option<PositionRange>,
}

/// In order of trial.
const FORMATS: [Format; 2] = [blender::FORMAT, seven_scenes::FORMAT];

/// Recognises the layout and reads it.
pub(super) fn parse(
    folder: &Folder,
    options: &LoadOptions,
) -> Result<(Layout, String, Parsed), DatasetError> {
    for format in &FORMATS {
        if let Some(why) = (format.recognise)(folder) {
            return Ok((format.layout, why, (format.parse)(folder, options)?));
        }
    }
    Err(DatasetError::NotRecognised {
        path: folder.path.clone(),
        expected: FORMATS.map(|f| f.looks_for).join("; "),
        found: folder.listing.summary(),
    })
}

impl Parsed {
    /// Notes a frame that cannot be used.
    pub fn skip(&mut self, split: &str, frame: &str, file: PathBuf, problem: FrameProblem) {
        let error = Arc::new(FrameError { file, frame: frame.to_owned(), problem });
        self.warnings.push(Warning { split: split.to_owned(), error });
    }
}

/// Whether a pinhole camera in a dataset can have this field of view: between 0.1 and 179 degrees.
pub(super) fn is_sane_field_of_view(degrees: f64) -> bool {
    degrees > 0.1 && degrees < 179.0
}

/// Refuses intrinsics that no camera has.
pub(super) fn check_intrinsics(file: &Path, k: &Intrinsics) -> Result<(), DatasetError> {
    let wrong = |expected: &str, found: String, hint: &str| {
        Err(DatasetError::Metadata {
            file: file.to_owned(),
            expected: expected.to_owned(),
            found,
            hint: hint.to_owned(),
        })
    };
    let fov_y = 2.0 * (0.5 * f64::from(k.height) / k.fy).atan();
    for (axis, fov) in [("horizontal", k.fov_x()), ("vertical", fov_y)] {
        let degrees = fov.to_degrees();
        if !is_sane_field_of_view(degrees) {
            let found = format!("{degrees:.4} degrees (focal lengths {} and {})", k.fx, k.fy);
            return wrong(
                &format!("a {axis} field of view between 0.1 and 179 degrees"),
                found,
                "correct the focal length, which is in pixels",
            );
        }
    }
    let inside = |c: f64, size: u32| c >= 0.0 && c <= f64::from(size);
    if !(inside(k.cx, k.width) && inside(k.cy, k.height)) {
        return wrong(
            &format!("a principal point inside the {}x{} image", k.width, k.height),
            format!("({}, {})", k.cx, k.cy),
            "use the intrinsics that belong to images of this size",
        );
    }
    Ok(())
}
