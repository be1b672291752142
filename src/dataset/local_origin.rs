//! The place that a far world is moved to, so that 32-bit positions resolve it.
//!
//! Map coordinates put a room millions of metres from zero, where `f32` steps by half a metre. Poses are
//! `f64` and lose nothing: cameras are handed out relative to a place beside the first of them, and all
//! that follows, from training to drawing, works there without knowing. Worlds near zero stay as they are,
//! to the bit. What is written says the place, and what is opened beside a model takes the model's.

use super::Dataset;
use super::entry::DatasetSplit;
use super::options::FARTHEST_SENSED;
use super::wild_poses::wild_poses;
use glam::DVec3;

/// Distance from zero beyond which a world is far, in depths that sensors reach: `f32` rounds by less than
/// 2⁻¹⁸ of such a depth below, a hundredth of a structural scale.
const FAR: f64 = 64.0;
/// The same in spreads of the cameras: a world as wide as it is far gains nothing by being moved.
const FAR_BESIDE_SPREAD: f64 = 8.0;

/// Moves the cameras to the place asked for, or to the one that their distance from zero asks for.
pub(super) fn settle(dataset: &mut Dataset, asked: Option<[f64; 3]>) {
    // A tracked world begins at its first camera.
    let found = if dataset.options.track { None } else { far_place(dataset) };
    let origin = asked.map(DVec3::from_array).or(found).unwrap_or(DVec3::ZERO);
    // Left out where it is zero: near worlds are saved as they were before.
    dataset.options.local_origin = (origin != DVec3::ZERO).then_some(origin.to_array());
    if origin != DVec3::ZERO {
        for frame in dataset.splits.iter_mut().flat_map(|split| &mut split.frames) {
            frame.camera.pose = frame.camera.pose.relative_to(origin);
        }
        dataset.known_range = dataset.known_range.take().map(|range| range.relative_to(origin));
    }
    let [x, y, z] = origin.to_array();
    match (asked, far_place(dataset)) {
        (Some(_), Some(place)) if !dataset.options.track => dataset.notes.push(format!(
            "the cameras lie {:.0} world units from the local origin ({x}, {y}, {z}) of the model beside them, where 32-bit positions are coarse: pictures and figures may be wrong; a model trained on this dataset anew, and its checkpoint, PLY and GLB, name an origin nearby",
            place.length()
        )),
        (None, _) if origin != DVec3::ZERO => dataset.notes.push(format!(
            "the cameras lie {:.0} world units from zero, where 32-bit positions are coarse: positions are kept relative to the local origin ({x}, {y}, {z})",
            origin.length()
        )),
        _ => {}
    }
}

/// A place beside the first sound camera in whole metres, if that is far from zero.
fn far_place(dataset: &Dataset) -> Option<DVec3> {
    let split = dataset.splits.get(dataset.training_split().unwrap_or(0))?;
    let metre = dataset.metre();
    let centre = first_sound(split)?;
    let distance = centre.length();
    let is_far = distance > FAR * FARTHEST_SENSED * metre
        && distance > FAR_BESIDE_SPREAD * spread(split, centre);
    // Whole metres: numbers that files and people can hold, and no phase for lattices that another unit
    // would change.
    is_far.then(|| (centre / metre).round() * metre)
}

/// Where the first camera stands whose pose can be.
fn first_sound(split: &DatasetSplit) -> Option<DVec3> {
    let wild = wild_poses(split);
    let is_sound = |i: &usize| wild.iter().all(|wild| wild.index != *i);
    let first = (0..split.frames.len()).find(is_sound).unwrap_or(0);
    Some(split.frames.get(first)?.camera.pose.centre())
}

/// Median distance of the cameras from a place.
fn spread(split: &DatasetSplit, centre: DVec3) -> f64 {
    let distance = |frame: &super::FrameEntry| frame.camera.pose.centre().distance(centre);
    let mut distances: Vec<f64> = split.frames.iter().map(distance).collect();
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}
