//! Local origin of worlds far from zero, so that 32-bit positions resolve them.
//!
//! Map coordinates put a room millions of metres from zero, where `f32` has a step of half a metre. Poses
//! are
//! `f64`: cameras are returned relative to a place near the first one, without loss, and everything after,
//! from training to rendering, works in these coordinates. Worlds near zero are unchanged to the bit. Files
//! store the origin, and a dataset opened with a model takes the model's.

use super::entry::{DatasetSplit, FrameEntry};
use super::options::FARTHEST_SENSED;
use super::wild_poses::outlier_poses;
use glam::DVec3;

/// Distance from zero beyond which a world is far, in multiples of the largest sensed depth. Below it,
/// `f32` rounds by less than 2⁻¹⁸ of such a depth, a hundredth of the structural scale.
const FAR: f64 = 64.0;
/// Least distance in spreads of the cameras: moving a world as wide as it is far gains nothing.
const FAR_BESIDE_SPREAD: f64 = 8.0;

/// Origin of the returned camera poses, and a notice for the user.
pub(super) struct LocalOrigin {
    /// In the files' world frame, world units.
    pub origin: DVec3,
    pub note: Option<String>,
}

impl LocalOrigin {
    /// Uses the given origin, or chooses one by the cameras' distance from zero; `metre` is world units per
    /// metre.
    pub fn of(split: &DatasetSplit, metre: f64, asked: Option<[f64; 3]>) -> Self {
        let Some(asked) = asked.map(DVec3::from_array) else {
            let place = far_origin(split, metre, DVec3::ZERO).unwrap_or(DVec3::ZERO);
            let note = (place != DVec3::ZERO).then(|| moved_notice(place));
            return Self { origin: place, note };
        };
        let beside = far_origin(split, metre, asked);
        Self { origin: asked, note: beside.map(|far| mismatch_notice(asked, far)) }
    }
}

fn moved_notice(place: DVec3) -> String {
    let ([x, y, z], distance) = (place.to_array(), place.length());
    format!(
        "the cameras lie {distance:.0} world units from zero, where 32-bit positions are coarse: positions are stored relative to the local origin ({x}, {y}, {z})"
    )
}

fn mismatch_notice(asked: DVec3, far: DVec3) -> String {
    let ([x, y, z], distance) = (asked.to_array(), far.length());
    format!(
        "the cameras lie {distance:.0} world units from the local origin ({x}, {y}, {z}) of the model beside them: expected cameras near it; pictures and metrics are imprecise or show another place; use a checkpoint, PLY or GLB trained on this dataset"
    )
}

/// Position near the first valid camera in whole metres, relative to `origin`, if it is far from `origin`.
fn far_origin(split: &DatasetSplit, metre: f64, origin: DVec3) -> Option<DVec3> {
    let centre = first_inlier_position(split)?;
    let from_origin = centre - origin;
    let distance = from_origin.length();
    let is_far = distance > FAR * FARTHEST_SENSED * metre
        && distance > FAR_BESIDE_SPREAD * spread(split, centre);
    // Whole metres: short numbers for files and users, and the phase of lattices does not depend on the
    // unit.
    is_far.then(|| (from_origin / metre).round() * metre)
}

/// Position of the first camera whose pose is not an outlier.
fn first_inlier_position(split: &DatasetSplit) -> Option<DVec3> {
    let wild = outlier_poses(split);
    let is_sound = |i: &usize| wild.iter().all(|wild| wild.index != *i);
    let first = (0..split.frames.len()).find(is_sound).unwrap_or(0);
    Some(split.frames.get(first)?.camera.pose.centre())
}

/// Median distance of the cameras from a position.
fn spread(split: &DatasetSplit, centre: DVec3) -> f64 {
    let distance = |frame: &FrameEntry| frame.camera.pose.centre().distance(centre);
    let mut distances: Vec<f64> = split.frames.iter().map(distance).collect();
    let middle = distances.len() / 2;
    *distances.select_nth_unstable_by(middle, f64::total_cmp).1
}
