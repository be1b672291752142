//! What a layout's file tells the registry.

use crate::dataset::calibration::Calibration;
use crate::dataset::entry::DatasetSplit;
use crate::dataset::error::{DatasetError, FrameError, FrameProblem, Warning};
use crate::dataset::folder::Folder;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use crate::dataset::position_range::PositionRange;
use crate::math::camera::Intrinsics;
use std::path::PathBuf;
use std::sync::Arc;

/// How one layout is recognised and read, and what is known of the cameras that record in it.
pub(in crate::dataset) struct DatasetFormat {
    /// What it is recognised by, for messages.
    pub looks_for: &'static str,
    /// What its pose matrices mean.
    pub poses: PoseConvention,
    /// What was found, if this is the layout. Must not fail on anything it does not know.
    pub recognise: fn(&Folder) -> Option<String>,
    /// Reads metadata and poses.
    pub parse: fn(&Folder, &LoadOptions) -> Result<ParsedFolder, DatasetError>,
    /// What is known, without a calibration, of cameras whose depth has these intrinsics.
    pub known_calibration: fn(&Intrinsics) -> Option<Calibration>,
}

/// What a layout's files say.
#[derive(Default)]
pub(in crate::dataset) struct ParsedFolder {
    /// May be empty; the caller drops such splits.
    pub splits: Vec<DatasetSplit>,
    pub warnings: Vec<Warning>,
    pub notes: Vec<String>,
    pub known_range: Option<PositionRange>,
}

impl ParsedFolder {
    /// Notes a frame that cannot be used.
    pub fn skip(&mut self, split: &str, frame: &str, file: PathBuf, problem: FrameProblem) {
        let error = Arc::new(FrameError { file, frame: frame.to_owned(), problem });
        self.warnings.push(Warning { split: split.to_owned(), error });
    }
}
