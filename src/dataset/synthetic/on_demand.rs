//! The procedural room as a dataset without files.

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::{PlannedSplit, ViewPlan};
use super::room;
use crate::dataset::entry::{DatasetSplit, FrameEntry, FrameSource};
use crate::dataset::formats::Layout;
use crate::dataset::opened::Dataset;
use crate::dataset::options::LoadOptions;
use crate::dataset::position_range::PositionRange;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use std::sync::Arc;

/// Returns the demo: [`SyntheticParams::demo`] as a dataset.
pub fn demo() -> Result<Dataset, ParamsError> {
    dataset(&SyntheticParams::demo())
}

/// Returns a dataset whose frames are rendered when loaded.
///
/// # Errors
/// Parameters outside their range, or the phone camera, whose recordings need files.
pub fn dataset(params: &SyntheticParams) -> Result<Dataset, ParamsError> {
    if params.camera != SyntheticCamera::Room {
        let found = "the phone, whose recordings must be written to files".to_owned();
        return Err(ParamsError { setting: "camera", expected: "the room's camera", found });
    }
    let ViewPlan { scene, splits, .. } = ViewPlan::new(params)?;
    let intrinsics = scene.intrinsics();
    let split = |planned: PlannedSplit| {
        let entry = |(i, pose): (usize, Pose)| FrameEntry {
            name: format!("{}/{i:04}", planned.name),
            camera: Camera { intrinsics, pose },
            color_camera: None,
            time: None,
            source: FrameSource::Synthetic {
                scene: Arc::clone(&scene),
                noise_stream: planned.noise_stream(i),
            },
        };
        let frames = planned.poses.iter().copied().enumerate().map(entry).collect();
        DatasetSplit { name: planned.name.to_owned(), frames, has_depth: true }
    };
    Ok(Dataset {
        name: "synthetic room".to_owned(),
        path: None,
        is_folder: false,
        layout: Layout::Synthetic,
        recognised_by: "generated, no files".to_owned(),
        splits: splits.into_iter().map(split).collect(),
        warnings: Vec::new(),
        notes: Vec::new(),
        known_range: position_range(),
        options: LoadOptions::default(),
    })
}

/// Bounds of the room: every point of the scene lies inside.
pub fn position_range() -> Option<PositionRange> {
    PositionRange::new(room::LO, room::HI, "the bounds of the synthetic room")
}
