//! The place that a far world is moved to, so that 32-bit positions resolve it.
//!
//! Map coordinates put a room millions of metres from zero, where `f32` steps by half a metre. Poses are
//! `f64` and lose nothing: cameras are handed out relative to a place beside the first of them, and all
//! that follows, from training to drawing, works there without knowing. Worlds near zero stay as they are,
//! to the bit. What is written says the place, and what is opened beside a model takes the model's.

use super::entry::{DatasetSplit, FrameEntry};
use super::options::FARTHEST_SENSED;
use super::wild_poses::wild_poses;
use glam::DVec3;

/// Distance from zero beyond which a world is far, in depths that sensors reach: `f32` rounds by less than
/// 2⁻¹⁸ of such a depth below, a hundredth of a structural scale.
const FAR: f64 = 64.0;
/// The same in spreads of the cameras: a world as wide as it is far gains nothing by being moved.
const FAR_BESIDE_SPREAD: f64 = 8.0;

/// Where cameras are told relative to, and what a user should know of it.
pub(super) struct LocalOrigin {
    /// In the world of the files, world units.
    pub place: DVec3,
    pub note: Option<String>,
}

impl LocalOrigin {
    /// As asked for, or as the distance of the cameras from zero asks for; `metre` in world units.
    pub fn of(split: &DatasetSplit, metre: f64, asked: Option<[f64; 3]>) -> Self {
        let Some(asked) = asked.map(DVec3::from_array) else {
            let place = far_place(split, metre, DVec3::ZERO).unwrap_or(DVec3::ZERO);
            let note = (place != DVec3::ZERO).then(|| moved(place));
            return Self { place, note };
        };
        let beside = far_place(split, metre, asked);
        Self { place: asked, note: beside.map(|far| mismatched(asked, far)) }
    }
}

fn moved(place: DVec3) -> String {
    let ([x, y, z], distance) = (place.to_array(), place.length());
    format!(
        "the cameras lie {distance:.0} world units from zero, where 32-bit positions are coarse: positions are kept relative to the local origin ({x}, {y}, {z})"
    )
}

fn mismatched(asked: DVec3, far: DVec3) -> String {
    let ([x, y, z], distance) = (asked.to_array(), far.length());
    format!(
        "the cameras lie {distance:.0} world units from the local origin ({x}, {y}, {z}) of the model beside them: expected cameras near it; pictures and figures are coarse or of another place; take a checkpoint, PLY or GLB that was trained on this dataset"
    )
}

/// A place beside the first sound camera in whole metres, relative to `origin`, if that is far from it.
fn far_place(split: &DatasetSplit, metre: f64, origin: DVec3) -> Option<DVec3> {
    let centre = first_sound(split)?;
    let from_origin = centre - origin;
    let distance = from_origin.length();
    let is_far = distance > FAR * FARTHEST_SENSED * metre
        && distance > FAR_BESIDE_SPREAD * spread(split, centre);
    // Whole metres: numbers that files and people can hold, and no phase for lattices that another unit
    // would change.
    is_far.then(|| (from_origin / metre).round() * metre)
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
    let distance = |frame: &FrameEntry| frame.camera.pose.centre().distance(centre);
    let mut distances: Vec<f64> = split.frames.iter().map(distance).collect();
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}
