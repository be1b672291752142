//! Interface between a layout's module and the registry.

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

/// Recognition and parsing of one layout, and known properties of its cameras.
pub(in crate::dataset) struct DatasetFormat {
    /// Identifying content, for messages.
    pub identified_by: &'static str,
    /// Convention of its pose matrices.
    pub poses: PoseConvention,
    /// Describes the identifying content found, if this is the layout. Must not fail on unknown content.
    pub recognise: fn(&Folder) -> Option<String>,
    /// Reads metadata and poses.
    pub parse: fn(&Folder, &LoadOptions) -> Result<ParsedFolder, DatasetError>,
    /// Calibration known for depth cameras with these intrinsics.
    pub known_calibration: fn(&Intrinsics) -> Option<Calibration>,
}

/// Content of a layout's files.
#[derive(Default)]
pub(in crate::dataset) struct ParsedFolder {
    /// Splits, possibly empty ones, which the caller drops.
    pub splits: Vec<DatasetSplit>,
    pub warnings: Vec<Warning>,
    pub notes: Vec<String>,
    pub known_range: Option<PositionRange>,
}

impl ParsedFolder {
    /// Adds a warning about a frame that cannot be used.
    pub fn skip(&mut self, split: &str, frame: &str, file: PathBuf, problem: FrameProblem) {
        let error = Arc::new(FrameError { file, frame: frame.to_owned(), problem });
        self.warnings.push(Warning { split: split.to_owned(), error });
    }
}
