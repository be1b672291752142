//! Trajectory of a tracked run, for evaluation, rendering and reports.
//!
//! Frames used in training keep the poses found during training. Other frames, such as held-out ones,
//! are tracked against the finished scene without training. If the recording has poses, they correct the
//! rolling shutter of the views' images, as in any other run.

use super::settings::scene::SceneRun;
use crate::dataset::error::FrameError;
use crate::dataset::surface::Preparer;
use crate::dataset::{Dataset, FrameEntry};
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::eval::trajectory_error::TrajectoryError;
use crate::export::mesh::Surfel;
use crate::math::measured_pixel::Normalization;
use crate::math::pose::Pose;
use crate::model::scene::state::TrackedPose;
use crate::model::splat::appearance::SplatView;
use crate::observation::surface::Observation;
use crate::train::learner::{Component, Learner};
use crate::train::scene::track::find_pose;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Camera poses found by tracking, by the name of the frame.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Trajectory {
    frames: BTreeMap<String, TrackedPose>,
    /// Names of frames that were unreadable or whose pose was not found.
    skipped: Vec<String>,
}

/// Views with tracked camera poses.
pub struct PlacedViews {
    /// Dataset whose cameras have the tracked poses.
    pub dataset: Dataset,
    /// Indices in the split of the requested views whose pose was found.
    pub frames: Vec<usize>,
    /// Views whose pose was not found, with reasons.
    pub lost: Vec<SkippedFrame>,
    /// True if the recorded poses were used to correct the rolling shutter of the images
    /// (`evaluation.md`, Views of tracked runs).
    pub is_straightened: bool,
}

impl Trajectory {
    /// Collects the trajectory from frame reports and skipped frames; `None` unless the run was tracked.
    pub fn of(frames: &[FrameReport], skipped: &[SkippedFrame]) -> Option<Self> {
        let named =
            frames.iter().filter_map(|report| Some((report.frame.clone(), report.tracked?)));
        let frames: BTreeMap<String, TrackedPose> = named.collect();
        let skipped = skipped.iter().map(|skipped| skipped.frame.clone()).collect();
        (!frames.is_empty()).then_some(Self { frames, skipped })
    }

    /// Tracked pose of a frame, if it was found.
    pub fn pose(&self, frame: &str) -> Option<Pose> {
        self.frames.get(frame)?.pose()
    }

    /// Number of frames with a tracked pose.
    pub fn n_placed(&self) -> usize {
        self.frames.len()
    }

    /// Names of frames that were unreadable or whose pose was not found.
    pub fn skipped(&self) -> &[String] {
        &self.skipped
    }

    /// Largest standard deviations of the tracked poses over all frames: rotation in radians, camera
    /// centre in world units.
    pub fn deviations(&self) -> [f64; 2] {
        self.frames.values().fold([0.0; 2], |[turn, shift], tracked| {
            [turn.max(tracked.turn_deviation), shift.max(tracked.shift_deviation)]
        })
    }

    /// Error of the tracked poses relative to the recorded poses, if the dataset has any.
    pub fn error(&self, dataset: &Dataset) -> Option<TrajectoryError> {
        let recorded = dataset.with_recorded_poses()?;
        let entries = recorded.splits.iter().flat_map(|split| &split.frames);
        let poses: BTreeMap<&str, Pose> =
            entries.map(|entry| (entry.name.as_str(), entry.camera.pose)).collect();
        let pair = |(name, tracked): (&String, &TrackedPose)| {
            Some((tracked.pose()?, *poses.get(name.as_str())?))
        };
        TrajectoryError::of(&self.frames.iter().filter_map(pair).collect::<Vec<_>>())
    }

    /// Formats one line `t tx ty tz qx qy qz qw` per frame (TUM RGB-D; camera to world), in the order of
    /// the split. Times are frame indices if the recording has no times.
    pub fn tum(&self, dataset: &Dataset, split: usize) -> String {
        let mut text = "# t tx ty tz qx qy qz qw\n".to_owned();
        for (i, entry) in dataset.splits[split].frames.iter().enumerate() {
            let Some(tracked) = self.frames.get(&entry.name) else { continue };
            let ([x, y, z], [qx, qy, qz, qw]) = (tracked.centre, tracked.rotation);
            let time = entry.time.unwrap_or(i as f64);
            // Writing to a string cannot fail.
            let _ =
                writeln!(text, "{time:.6} {x:.6} {y:.6} {z:.6} {qx:.7} {qy:.7} {qz:.7} {qw:.7}");
        }
        text
    }
}

impl PlacedViews {
    /// Finds the poses of the listed views of a split. Frames trained on keep their tracked poses;
    /// others are tracked against `splats`, the finished scene. Calls `progress` with the number of
    /// processed views.
    pub fn find(
        dataset: &Dataset,
        (run, splats): (&SceneRun, SplatView<'_>),
        trajectory: &Trajectory,
        (split, views): (usize, &[usize]),
        mut progress: impl FnMut(usize),
    ) -> Self {
        let straightened = dataset.rectified();
        let is_straightened = straightened.is_some();
        let mut placed = straightened.unwrap_or_else(|| dataset.clone());
        for entry in placed.splits.iter_mut().flat_map(|split| &mut split.frames) {
            entry.camera.pose = trajectory.pose(&entry.name).unwrap_or(entry.camera.pose);
        }
        let known: Vec<Pose> = trajectory.frames.values().filter_map(TrackedPose::pose).collect();
        let mut preparer = Preparer::new();
        let (mut frames, mut lost) = (Vec::new(), Vec::new());
        for (done, &view) in views.iter().enumerate() {
            let entry = &placed.splits[split].frames[view];
            let found = match trajectory.pose(&entry.name) {
                // A trained frame keeps the pose at which it was trained on.
                Some(pose) => Ok(pose),
                None => {
                    let guesses = trajectory.neighbour_poses(dataset, entry);
                    place((run, splats), entry, &mut preparer, &guesses, &known)
                }
            };
            match found {
                Ok(pose) => {
                    placed.splits[split].frames[view].camera.pose = pose;
                    frames.push(view);
                }
                Err(skipped) => lost.push(skipped),
            }
            progress(done + 1);
        }
        Self { dataset: placed, frames, lost, is_straightened }
    }
}

impl Trajectory {
    /// Returns the tracked poses of the closest frames before and after a frame in its recording,
    /// nearest first.
    fn neighbour_poses(&self, dataset: &Dataset, entry: &FrameEntry) -> Vec<Pose> {
        // In every split: in `held-out`, the neighbours of a frame are missing.
        let holds = |frames: &[FrameEntry]| frames.iter().position(|f| f.name == entry.name);
        let frames = dataset.splits.iter().map(|split| split.frames.as_slice());
        let tracked = frames.filter_map(|frames| Some((holds(frames)?, frames)));
        let mut found: Vec<(usize, Pose)> = tracked
            .flat_map(|(at, frames)| {
                let pose = |i: usize| self.pose(&frames[i].name).map(|pose| (i.abs_diff(at), pose));
                let before = (0..at).rev().find_map(pose);
                before.into_iter().chain((at + 1..frames.len()).find_map(pose))
            })
            .collect();
        found.sort_by_key(|(apart, _)| *apart);
        found.into_iter().map(|(_, pose)| pose).collect()
    }
}

/// Finds the pose of a frame near `guesses`, otherwise near any of the `known` poses.
fn place(
    (run, splats): (&SceneRun, SplatView<'_>),
    entry: &FrameEntry,
    preparer: &mut Preparer,
    guesses: &[Pose],
    known: &[Pose],
) -> Result<Pose, SkippedFrame> {
    let skipped = |error: FrameError| SkippedFrame::from(&error);
    let frame = entry.load().map_err(skipped)?;
    let mut observation = Observation::empty();
    preparer.prepare(&frame, &run.surface, &mut observation).map_err(skipped)?;
    let lost = |message: String| SkippedFrame { frame: entry.name.clone(), message };
    let found = find_pose(splats, &observation, guesses, known)
        .map_err(|loss| lost(format!("{}: not placed: {loss}", entry.name)))?;
    found.pose().ok_or_else(|| lost(format!("{}: not placed", entry.name)))
}

/// Returns the plane segments of a learner, each with its component's index: one for every drawn
/// component with a known normal. Models of the `paper` preset have none.
pub fn surfels(learner: &dyn Learner, normalization: &Normalization) -> Vec<(usize, Surfel)> {
    let splats = learner.splats();
    let textures = splats.finishing().textures.as_ref();
    let of = |component: usize| {
        if !splats[component].is_drawable() {
            return None;
        }
        let Component { posterior, normal, .. } = learner.component(component);
        let surfel = Surfel {
            mean: normalization.denormalize(posterior.mean_space),
            normal: normal?,
            covariance: posterior.world_covariance(normalization),
            color: Normalization::denormalize_color(posterior.mean_color),
            evidence: posterior.count,
            // Splats newer than the textures have none yet.
            texture: textures.and_then(|all| all.get(component)?.clone()),
        };
        Some((component, surfel))
    };
    (0..splats.len()).filter_map(of).collect()
}
