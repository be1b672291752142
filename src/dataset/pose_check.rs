//! Checks the pose convention without ground truth: depth of a frame, transformed by both poses into a
//! neighbouring frame, must match the neighbour's depth.
//!
//! A wrong convention loads without an error and yields a useless model. So other conventions and depth
//! units are tried on the same pairs of frames, and a far better one is suggested. The camera must have
//! moved within a pair: without motion every convention fits, and with pure rotation every unit fits.

use super::entry::{DatasetSplit, FrameEntry};
use super::opened::Dataset;
use super::range::median;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::pose::{Pose, PoseError};
use glam::{DMat4, DVec3, DVec4};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::cmp::Ordering;
use strum::{EnumIter, EnumMessage, EnumString, IntoEnumIterator, IntoStaticStr, VariantNames};

const MAX_PAIRS: usize = 8;
/// Distances between the frames of a pair, in frames; tried in order until the camera has moved enough.
const GAPS: [usize; 6] = [1, 2, 4, 8, 16, 32];
/// Sufficient camera motion within a pair of frames: translation as a share of the median depth, or
/// rotation in radians.
const MIN_MOTION: [f64; 2] = [0.05, 0.1];
/// Number of frames of a growing recording after which its poses can be checked. With fewer frames, the
/// camera has hardly moved.
pub const ENOUGH_FRAMES: usize = 33;
/// Approximate number of samples along a row or column of a depth image.
const SAMPLES: usize = 36;
/// Largest relative difference between depths that count as matching.
const TOLERANCE: f64 = 0.04;
/// Minimum share of samples that must project into the neighbour's image. If fewer do, the missing
/// samples are counted as mismatches.
const MIN_OVERLAP: f64 = 0.25;
/// Largest depth factor that is searched; the smallest is its reciprocal. It includes metres for steps of
/// a tenth of a millimetre.
const MAX_UNIT: f64 = 10_000.0;
/// Ratio of neighbouring depth factors of the search. Depth within [`TOLERANCE`] of one of them agrees.
const UNIT_STEP: f64 = 1.05;
/// Conditions for suggesting another interpretation (pose convention with depth unit): minimum gain in
/// agreement over the interpretation in use, and minimum agreement.
const MIN_GAIN: [f64; 2] = [0.2, 0.5];
/// Conditions for suggesting another depth unit for the same poses with a smaller gain in agreement:
/// minimum gain, largest share of the relative error that remains, and minimum change of the unit.
const MIN_UNIT_GAIN: [f64; 3] = [0.02, 0.5, 0.05];

/// Result of the pose check.
#[derive(Clone, Debug, PartialEq)]
pub struct PoseCheck {
    /// Number of compared pairs of frames.
    pub pairs: usize,
    /// Interpretation used when the recording was opened.
    pub opened: PoseTrial,
    /// True if the user chose the pose convention, false if it is the layout's.
    pub is_user_set: bool,
    /// Best interpretation; equals `opened` unless another one is far better.
    pub best: PoseTrial,
}

/// Interpretation of poses and depth (pose convention and depth unit), and how well it fits the compared
/// pairs of frames.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseTrial {
    /// Convention of the pose matrices.
    pub poses: PoseConvention,
    /// Factor on the depth of the opened dataset.
    pub unit: f64,
    /// Share of samples that match the neighbour's depth, 0 to 1.
    pub agreement: f64,
    /// Median difference from the neighbour's depth along the optical axis, world units.
    pub error: f64,
}

impl PoseCheck {
    /// True if another interpretation of poses and depth fits better than the one in use.
    pub fn has_better_reading(&self) -> bool {
        self.best != self.opened
    }
}

/// Compares the depth of a split's frames with that of neighbouring frames, for several pose
/// conventions and depth units. Returns `None` if no two frames can be compared, or if poses are left
/// to tracking.
///
/// ```
/// use vbgs_studio::dataset::{PoseConvention, pose_check};
///
/// let room = vbgs_studio::dataset::synthetic::demo()?;
/// let check = pose_check::check(&room, 0).ok_or("too few frames")?;
/// assert!(check.opened.agreement > 0.8 && !check.has_better_reading(), "{check:?}");
/// assert_eq!(check.opened.poses, PoseConvention::Opencv);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn check(dataset: &Dataset, split: usize) -> Option<PoseCheck> {
    if dataset.options.track {
        return None;
    }
    let split = dataset.splits.get(split)?;
    let stated = dataset.options.poses.unwrap_or(dataset.layout.pose_convention());
    let pairs = pairs(split);
    if pairs.is_empty() {
        return None;
    }
    let trial = |poses, unit| PoseTrial::of(&pairs, stated, poses, unit);
    let opened = trial(stated, 1.0);
    // Higher agreement leaves no room for a better interpretation.
    let is_open = |poses: &PoseConvention| {
        let gain = if *poses == stated { MIN_UNIT_GAIN[0] } else { MIN_GAIN[0] };
        opened.agreement < 1.0 - gain
    };
    let conventions: Vec<_> = PoseConvention::iter().filter(is_open).collect();
    let trials = conventions.into_par_iter().map(|poses| best_unit(|unit| trial(poses, unit)));
    let best = trials.collect::<Vec<_>>().into_iter().max_by(PoseTrial::by_agreement);
    let best = best.filter(|best| best.agreement > MIN_GAIN[1] && best.is_better_than(&opened));
    Some(PoseCheck {
        pairs: pairs.len(),
        opened,
        is_user_set: dataset.options.poses.is_some(),
        best: best.unwrap_or(opened),
    })
}

/// Finds the depth factor of the highest agreement, and then that of the smallest relative error near it,
/// with three digits. Of factors that agree alike, the one nearest to 1 is taken.
fn best_unit(trial: impl Fn(f64) -> PoseTrial) -> PoseTrial {
    let n = (MAX_UNIT.ln() / UNIT_STEP.ln()).ceil() as i32;
    // `max_by` returns the last of equals, so the nearest to 1 comes last.
    let near_last = (1..=n).rev().flat_map(|i| [-i, i]).chain([0]);
    let coarse = near_last.map(|i| trial(UNIT_STEP.powi(i))).max_by(PoseTrial::by_agreement);
    let mut best = coarse.unwrap_or_else(|| trial(1.0));
    let mut step = UNIT_STEP.ln();
    while step > 1e-3 {
        let units = [-1.0, -0.5, 0.0, 0.5, 1.0].map(|i: f64| best.unit * (i * step).exp());
        let errors = units.map(&trial);
        best =
            errors.into_iter().min_by(|a, b| a.relative().total_cmp(&b.relative())).unwrap_or(best);
        step *= 0.5;
    }
    // Through text: the nearest number, which prints with three digits.
    trial(format!("{:.2e}", best.unit).parse().unwrap_or(best.unit))
}

/// Depth samples of one frame in its camera's axes, and the depth of a neighbouring frame with the same
/// surfaces.
struct FramePair {
    samples: Vec<DVec3>,
    from: Pose,
    to: Pose,
    intrinsics: Intrinsics,
    measured: Image<f64>,
}

fn pairs(split: &DatasetSplit) -> Vec<FramePair> {
    let n = split.frames.len();
    let anchors = n.min(MAX_PAIRS);
    // Evenly spaced over the recording: one unlucky stretch must not decide.
    (0..anchors).filter_map(|i| pair(split.frames.get(i * n / anchors..)?)).collect()
}

fn pair(frames: &[FrameEntry]) -> Option<FramePair> {
    let first = frames.first()?;
    let depth = trusted_z(first)?;
    let usual = median(depth.data.iter().copied().filter(|z| *z > 0.0).collect())?;
    let (from, k) = (first.camera.pose, first.camera.intrinsics);
    let has_moved = |other: &&FrameEntry| {
        let to = other.camera.pose;
        let turn = to.rotation().transpose() * from.rotation();
        // Rounding may push the cosine beyond 1.
        let angle = (0.5 * (turn.x_axis.x + turn.y_axis.y + turn.z_axis.z - 1.0)).clamp(-1.0, 1.0);
        // Either suffices: a wrong pose may rotate where the camera moved straight.
        from.centre().distance(to.centre()) > MIN_MOTION[0] * usual || angle.acos() > MIN_MOTION[1]
    };
    let candidates = || GAPS.iter().filter_map(|gap| frames.get(*gap));
    // If the camera hardly moves, the largest gap is compared.
    let second = candidates().find(has_moved).or_else(|| candidates().next_back())?;
    let (columns, rows) = (stride(depth.width), stride(depth.height));
    let mut samples = Vec::new();
    for row in (rows / 2..depth.height).step_by(rows) {
        for column in (columns / 2..depth.width).step_by(columns) {
            let z = *depth.at(column, row);
            if z > 0.0 {
                samples.push(k.ray(column, row) * z);
            }
        }
    }
    Some(FramePair {
        samples,
        from,
        to: second.camera.pose,
        intrinsics: second.camera.intrinsics,
        measured: trusted_z(second)?,
    })
}

fn stride(side: usize) -> usize {
    (side / SAMPLES).max(1)
}

fn trusted_z(entry: &FrameEntry) -> Option<Image<f64>> {
    Some(entry.load_depth().ok().flatten()?.trusted_z(&entry.camera.intrinsics))
}

impl PoseTrial {
    fn by_agreement(&self, other: &Self) -> Ordering {
        self.agreement.total_cmp(&other.agreement)
    }

    /// Returns the error in units of recorded depth, comparable between depth units.
    fn relative(&self) -> f64 {
        self.error / self.unit
    }

    fn is_better_than(&self, other: &Self) -> bool {
        let gain = self.agreement - other.agreement;
        let [least, remaining, change] = MIN_UNIT_GAIN;
        let is_unit = self.poses == other.poses && (self.unit / other.unit).ln().abs() > change;
        let is_closer = self.relative() < remaining * other.relative();
        gain > MIN_GAIN[0] || gain > least && is_unit && is_closer
    }

    fn of(pairs: &[FramePair], stated: PoseConvention, poses: PoseConvention, unit: f64) -> Self {
        let (mut n_agreed, mut n_counted, mut errors) = (0.0, 0.0, Vec::new());
        for pair in pairs {
            // Never fails: a rigid pose is rigid in every convention.
            let read = |pose: &Pose| poses.pose(stated.matrix(pose)).unwrap_or(*pose);
            let (from, to) = (read(&pair.from), read(&pair.to));
            let (rotation, shift) = to.inverse();
            let k = &pair.intrinsics;
            let mut n_inside = 0usize;
            for sample in &pair.samples {
                // A unit scales depth, but not the positions of the cameras.
                let p = rotation * from.transform_point(*sample * unit) + shift;
                // NaN or infinite for a point in the camera's plane; the test below is false then.
                let at = [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy];
                let is_inside = p.z > 0.0
                    && (0.0..f64::from(k.width)).contains(&at[0])
                    && (0.0..f64::from(k.height)).contains(&at[1]);
                if !is_inside {
                    continue;
                }
                let measured = unit * pair.measured.at(at[0] as usize, at[1] as usize);
                if measured > 0.0 {
                    n_inside += 1;
                    let error = (p.z - measured).abs();
                    errors.push(error);
                    n_agreed += f64::from(u8::from(error <= TOLERANCE * measured));
                }
            }
            n_counted += (n_inside as f64).max(MIN_OVERLAP * pair.samples.len() as f64);
        }
        let error = median(errors).unwrap_or(f64::INFINITY);
        Self { poses, unit, agreement: n_agreed / f64::max(n_counted, 1.0), error }
    }
}

/// Convention of a recording's pose matrices.
///
/// ```
/// use vbgs_studio::dataset::PoseConvention;
/// use vbgs_studio::math::pose::Pose;
///
/// let opengl = PoseConvention::Opengl.matrix(&Pose::IDENTITY);
/// assert_eq!(PoseConvention::Opengl.pose(opengl), Ok(Pose::IDENTITY));
/// assert_ne!(PoseConvention::Opencv.pose(opengl), Ok(Pose::IDENTITY));
/// ```
#[derive(
    Clone,
    Copy,
    Debug,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    EnumIter,
    EnumMessage,
    EnumString,
    IntoStaticStr,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PoseConvention {
    /// Camera to world, x right, y down, z forward.
    Opencv,
    /// Camera to world, x right, y up, viewing along −z.
    Opengl,
    /// World to camera, x right, y down, z forward.
    OpencvWorldToCamera,
    /// World to camera, x right, y up, viewing along −z.
    OpenglWorldToCamera,
    /// Camera to world, x forward, y left, z up, as for the body of a robot.
    Robot,
}

impl PoseConvention {
    /// Returns the name in options and messages, such as `opencv-world-to-camera`.
    pub fn name(self) -> &'static str {
        self.into()
    }

    /// Converts a matrix of this convention to a pose.
    ///
    /// # Errors
    /// The matrix is not a rigid motion.
    pub fn pose(self, matrix: DMat4) -> Result<Pose, PoseError> {
        let axes = self.axes();
        match self.is_world_to_camera() {
            false => Pose::from_opencv(matrix * axes),
            // Checked before the inversion, so that the error reports the numbers of the file.
            true => Pose::from_opencv(inverse(&Pose::from_opencv(matrix)?) * axes),
        }
    }

    /// Converts a pose to a matrix of this convention.
    pub fn matrix(self, pose: &Pose) -> DMat4 {
        // The axes are orthogonal, so their transpose is their inverse.
        let world_from_camera = pose.to_opencv() * self.axes().transpose();
        match self.is_world_to_camera() {
            false => world_from_camera,
            true => world_from_camera.inverse(),
        }
    }

    fn is_world_to_camera(self) -> bool {
        matches!(self, Self::OpencvWorldToCamera | Self::OpenglWorldToCamera)
    }

    /// Returns the transform from OpenCV camera axes to the axes of this convention.
    fn axes(self) -> DMat4 {
        match self {
            Self::Opencv | Self::OpencvWorldToCamera => DMat4::IDENTITY,
            Self::Opengl | Self::OpenglWorldToCamera => {
                DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0))
            }
            Self::Robot => DMat4::from_cols(-DVec4::Y, -DVec4::Z, DVec4::X, DVec4::W),
        }
    }
}

fn inverse(pose: &Pose) -> DMat4 {
    let (rotation, translation) = pose.inverse();
    let mut m = DMat4::from_mat3(rotation);
    m.w_axis = translation.extend(1.0);
    m
}

#[cfg(test)]
mod pose_convention_tests {
    use super::*;

    #[test]
    fn every_convention_reads_back_what_it_writes() {
        let pose = Pose::look_at(DVec3::new(3.0, 0.5, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        for convention in PoseConvention::iter() {
            let back = convention.pose(convention.matrix(&pose)).unwrap();
            let error = back.to_opencv() - pose.to_opencv();
            let largest = error.to_cols_array().iter().fold(0.0f64, |a, v| a.max(v.abs()));
            assert!(largest < 1e-12, "{}: {largest}", convention.name());
        }
        assert_eq!(PoseConvention::OpencvWorldToCamera.name(), "opencv-world-to-camera");
    }
}
