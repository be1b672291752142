//! Photographs and depth without poses: `color/` (`image/`, `rgb/`) and `depth/`, with the same numbers;
//! the camera as in the Open3D layout. Such frames need tracking.

use super::format::{DatasetFormat, ParsedFolder};
use super::paired;
use super::recording::{RecordedFrame, Recording, metadata_error};
use crate::dataset::distortion::Distortion;
use crate::dataset::entry::DepthSource;
use crate::dataset::error::{DatasetError, FrameProblem};
use crate::dataset::folder::Folder;
use crate::dataset::options::LoadOptions;
use crate::dataset::pose_convention::PoseConvention;
use crate::math::pose::Pose;

pub(super) const FORMAT: DatasetFormat = DatasetFormat {
    identified_by: "photographs and depth without poses: `color/` and `depth/`",
    poses: PoseConvention::Opencv,
    recognise: |folder| paired::recognise(folder).map(|images| format!("{images}, without poses")),
    parse,
    known_calibration: |_| None,
};

fn parse(folder: &Folder, options: &LoadOptions) -> Result<ParsedFolder, DatasetError> {
    if !options.track {
        let found = "images only".to_owned();
        let hint = "estimate the poses with --poses track, or add the poses";
        return Err(metadata_error(&folder.path, "poses of the frames", found, hint));
    }
    let mut recording = Recording::new(folder, options);
    let Some((pairs, cameras)) = paired::read(&mut recording)? else {
        return Ok(recording.finish());
    };
    let encoding = paired::encoding(&recording);
    for (number, pair) in &pairs {
        if folder.was_taken(&pair.name) {
            continue;
        }
        let missing = || FrameProblem::MissingColor(format!("number {number}"));
        let color = pair.color.clone().ok_or_else(missing);
        match color.and_then(|color| Ok((color, pair.depth()?))) {
            Ok((color, depth)) => recording.push(RecordedFrame {
                name: pair.name.clone(),
                time: None,
                pose: Pose::IDENTITY,
                cameras,
                color,
                depth: Some(DepthSource { file: depth, encoding, confidence: None }),
                lens: Distortion::default(),
            }),
            // The other file of the pair may still be written.
            Err(_) if folder.is_growing() => {}
            Err(problem) => recording.skip(&pair.name, folder.path.clone(), problem),
        }
    }
    Ok(recording.finish())
}
