//! State of a trained scene as columns of numbers, as stored in checkpoints.

use super::photometric::PhotometricState;
use super::sums::N_SUMS;
use crate::math::pose::{Pose, unit_rotation};
use crate::model::splat::pose_log::{FrameExposure, FramePose};
use bytemuck::{Pod, Zeroable};
use glam::{DMat4, DQuat, DVec3};
use serde::{Deserialize, Serialize};

/// Unit of integer sums. Their values are exact in f64 as long as a sum is below [`MAX_SUM`].
// Terms up to 7.84 take 18 bits, and 4,096 of them 30: finer quanta would spill rows sooner.
pub const QUANTUM: f64 = 1.0 / 32768.0;

/// Number of points from which a component's sums are stored in a wide row ([`WideRow`]). A row of
/// 32-bit quanta can hold the terms of twice as many points, for offsets within ±2.8 structural scales.
pub const WIDE_POINTS: u32 = 1 << 12;

/// Largest sum of a wide row: 2⁵³ quanta.
pub const MAX_SUM: f64 = (1u64 << 38) as f64;

/// Denominator of the entries of [`SceneState::shares`]; an entry of this value means the full
/// structural scale.
pub const WHOLE: u8 = 64;

/// Maximum number of steps by which the structural scale grows, each by a factor of √2: to 64 times its
/// original value.
// At that limit a whole seed's share is 1/64 of the scale.
pub const MAX_COARSENING_STEPS: u32 = 12;

/// A trained scene between two frames. Row `k` of the sums and visibility counts is component `k`; a row
/// to which no seed refers is unused.
#[derive(Clone, Debug, PartialEq)]
pub struct SceneState {
    /// World position relative to which the seeds are stored.
    pub origin: [f64; 3],
    /// Number of steps of √2 by which the structural scale exceeds the configured one, at most
    /// [`MAX_COARSENING_STEPS`].
    pub coarsening_steps: u32,
    /// Seeds (the points at which components were created), world units from `origin`, in order of
    /// creation.
    pub seeds: Vec<[f32; 3]>,
    /// For each seed, the maximum distance of its points as a fraction of the structural scale, in
    /// multiples of 1/[`WHOLE`]. `None` if all entries are [`WHOLE`].
    pub shares: Option<Vec<u8>>,
    /// For each seed, the index of its component. `None` while seed `k` belongs to component `k`; merged
    /// components share one row.
    pub components: Option<Vec<u32>>,
    /// Sums over all points so far, relative to the seeds.
    pub sums: StoredSums,
    /// Visibility counts, one entry per component.
    pub visibility: Vec<VisibilityCounts>,
    /// Exposures of the frames in training order, if gains are estimated.
    pub exposures: Vec<FrameExposure>,
    /// Pose corrections of the frames in training order, unless recorded poses are treated as exact.
    pub poses: Vec<FramePose>,
    /// Estimated camera poses in tracking order, if poses are tracked.
    pub trajectory: Vec<TrackedPose>,
    /// Photometric state, one row per component, if splats are trained on photographs.
    pub photometric: Option<PhotometricState>,
}

/// Visibility of a component over all frames, from which its opacity is derived. Every count saturates.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct VisibilityCounts {
    /// Number of points expected from the component, in 64ths.
    pub expected: u32,
    /// Number of frames that measured a surface at the component.
    pub hits: u16,
    /// Number of frames that measured a farther surface behind the component.
    pub misses: u16,
}

impl VisibilityCounts {
    /// Adds the counts of `other`; each sum saturates.
    pub fn plus(self, other: Self) -> Self {
        Self {
            expected: self.expected.saturating_add(other.expected),
            hits: self.hits.saturating_add(other.hits),
            misses: self.misses.saturating_add(other.misses),
        }
    }
}

/// Sums of all components, each in the order listed at [`N_SUMS`]; offsets are in units of the
/// structural scale.
#[derive(Clone, Debug, PartialEq)]
pub struct StoredSums {
    /// One row per component, in multiples of [`QUANTUM`]; zeros where the sums are in `wide`.
    pub rows: Vec<[i32; N_SUMS]>,
    /// Rows of components with [`WIDE_POINTS`] points or more, by ascending id.
    pub wide: Vec<WideRow>,
}

/// Sums of one component with many points, whole multiples of [`QUANTUM`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WideRow {
    /// Index of the component.
    pub id: u32,
    /// Sums of the component in the order listed at [`N_SUMS`].
    pub sums: [f64; N_SUMS],
}

/// Tracked camera pose of one frame and its uncertainty.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable, Serialize, Deserialize)]
#[repr(C)]
pub struct TrackedPose {
    /// Camera centre, world units; the origin for the first frame.
    pub centre: [f64; 3],
    /// Rotation from the camera's OpenCV axes to the world's: unit quaternion x, y, z, w.
    pub rotation: [f64; 4],
    /// Standard deviation of the rotation about the least certain axis, radians.
    pub turn_deviation: f64,
    /// Standard deviation of the centre along the least certain axis, world units.
    pub shift_deviation: f64,
    /// Share of the frame that the scene covers from the tracked pose, 0 to 1.
    pub overlap: f64,
    /// Agreement of depth and colour between frame and scene at the tracked pose, 0 to 1.
    pub agreement: f64,
}

impl TrackedPose {
    /// Creates the pose of the first frame, which defines the world.
    pub fn first(pose: &Pose) -> Self {
        Self::new(pose, [0.0; 2], 1.0, 1.0)
    }

    /// Creates a pose with the standard deviations of its rotation (radians) and centre (world units).
    pub fn new(pose: &Pose, deviations: [f64; 2], overlap: f64, agreement: f64) -> Self {
        let [turn_deviation, shift_deviation] = deviations;
        // Normalised, since reading refuses quaternions of another length.
        let rotation = DQuat::from_mat3(&pose.rotation()).normalize().to_array();
        let centre = pose.centre().to_array();
        Self { centre, rotation, turn_deviation, shift_deviation, overlap, agreement }
    }

    /// Returns the pose; `None` if the stored numbers do not form one.
    pub fn pose(&self) -> Option<Pose> {
        let rotation = unit_rotation(self.rotation)?;
        let matrix = DMat4::from_rotation_translation(rotation, DVec3::from_array(self.centre));
        Pose::from_opencv(matrix).ok()
    }
}

#[cfg(test)]
mod trajectory_tests {
    use super::*;

    #[test]
    fn poses_are_read_back() {
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        let tracked = TrackedPose::new(&pose, [0.001, 0.002], 0.9, 0.8);
        let apart = tracked.pose().unwrap().to_opencv() - pose.to_opencv();
        assert!(apart.to_cols_array().iter().all(|x| x.abs() < 1e-12));
        let nonsense = TrackedPose { rotation: [f64::NAN, 0.0, 0.0, 1.0], ..tracked };
        assert_eq!(nonsense.pose(), None);
    }
}
