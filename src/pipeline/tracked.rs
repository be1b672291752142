//! Frames of a tracked run with the poses that were found: what measuring, drawing and reporting
//! need of it.
//!
//! Frames that were learnt have the poses they were learnt at. Others, such as those held out for
//! evaluation, are placed by the finished scene as it placed the ones it learnt, and teach nothing. Where the
//! recording has poses, what views are compared with is straightened by them, as that of any other run.

use super::settings::scene::SceneRun;
use crate::dataset::error::FrameError;
use crate::dataset::surface::Preparer;
use crate::dataset::{Dataset, FrameEntry};
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::eval::trajectory_error::TrajectoryError;
use crate::math::pose::Pose;
use crate::model::scene::trajectory::TrackedPose;
use crate::model::splat::appearance::SplatView;
use crate::observation::surface::Observation;
use crate::train::scene::track::place;
use serde::Serialize;
use std::collections::BTreeMap;
use std::fmt::Write;

/// Where the frames of a run were found, by name.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Trajectory {
    frames: BTreeMap<String, TrackedPose>,
    /// Names of frames that were not placed, or could not be read.
    skipped: Vec<String>,
}

/// Views with the poses that were found for them.
pub struct PlacedViews {
    /// The dataset, all of its frames placed that could be.
    pub dataset: Dataset,
    /// Positions in its split of the views asked for that were placed.
    pub frames: Vec<usize>,
    /// Views that could not be placed, and why.
    pub lost: Vec<SkippedFrame>,
    /// Whether recorded poses straightened the images of the views (`eval.md`, Views of tracked runs).
    pub is_straightened: bool,
}

impl Trajectory {
    /// Of a run that has learnt and skipped these frames; `None` unless it was tracked.
    pub fn of(frames: &[FrameReport], skipped: &[SkippedFrame]) -> Option<Self> {
        let named =
            frames.iter().filter_map(|report| Some((report.frame.clone(), report.tracked?)));
        let frames: BTreeMap<String, TrackedPose> = named.collect();
        let skipped = skipped.iter().map(|skipped| skipped.frame.clone()).collect();
        (!frames.is_empty()).then_some(Self { frames, skipped })
    }

    /// Where a frame was found.
    pub fn pose(&self, frame: &str) -> Option<Pose> {
        self.frames.get(frame)?.pose()
    }

    /// Frames that were found.
    pub fn len(&self) -> usize {
        self.frames.len()
    }

    /// Whether none was.
    pub fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    /// Names of the frames that were not placed, or could not be read.
    pub fn skipped(&self) -> &[String] {
        &self.skipped
    }

    /// The least certain of all: deviations of turn (radians) and centre (world units).
    pub fn deviations(&self) -> [f64; 2] {
        self.frames.values().fold([0.0; 2], |[turn, shift], tracked| {
            [turn.max(tracked.turn_deviation), shift.max(tracked.shift_deviation)]
        })
    }

    /// How far it is from the poses of the recording, where that has any.
    pub fn error(&self, dataset: &Dataset) -> Option<TrajectoryError> {
        let recorded = dataset.recorded()?;
        let entries = recorded.splits.iter().flat_map(|split| &split.frames);
        let poses: BTreeMap<&str, Pose> =
            entries.map(|entry| (entry.name.as_str(), entry.camera.pose)).collect();
        let pair = |(name, tracked): (&String, &TrackedPose)| {
            Some((tracked.pose()?, *poses.get(name.as_str())?))
        };
        TrajectoryError::of(&self.frames.iter().filter_map(pair).collect::<Vec<_>>())
    }

    /// Lines of `t tx ty tz qx qy qz qw` (TUM RGB-D), camera to world, in the order of the split;
    /// times are frame numbers where the recording tells none.
    pub fn tum(&self, dataset: &Dataset, split: usize) -> String {
        let mut text = "# t tx ty tz qx qy qz qw\n".to_owned();
        for (i, entry) in dataset.splits[split].frames.iter().enumerate() {
            let Some(tracked) = self.frames.get(&entry.name) else { continue };
            let ([x, y, z], [qx, qy, qz, qw]) = (tracked.centre, tracked.rotation);
            let time = entry.time.unwrap_or(i as f64);
            // Text grows without end: it cannot fail.
            let _ =
                writeln!(text, "{time:.6} {x:.6} {y:.6} {z:.6} {qx:.7} {qy:.7} {qz:.7} {qw:.7}");
        }
        text
    }
}

impl PlacedViews {
    /// Places the listed views of a split of the recording that a scene was tracked on; `splats` are
    /// the scene's, `tell` hears how many views are done.
    pub fn find(
        dataset: &Dataset,
        (run, splats): (&SceneRun, SplatView<'_>),
        trajectory: &Trajectory,
        (split, views): (usize, &[usize]),
        mut tell: impl FnMut(usize),
    ) -> Self {
        let straightened = dataset.straightened();
        let is_straightened = straightened.is_some();
        let mut placed = straightened.unwrap_or_else(|| dataset.clone());
        for entry in placed.splits.iter_mut().flat_map(|split| &mut split.frames) {
            entry.camera.pose = trajectory.pose(&entry.name).unwrap_or(entry.camera.pose);
        }
        let mut placer = Placer { run, splats, trajectory, preparer: Preparer::new() };
        let (mut frames, mut lost) = (Vec::new(), Vec::new());
        for (done, &view) in views.iter().enumerate() {
            let entry = &placed.splits[split].frames[view];
            let found = match trajectory.pose(&entry.name) {
                Some(pose) => Ok(pose),
                None => placer.place(entry, &trajectory.around(dataset, entry)),
            };
            match found {
                Ok(pose) => {
                    placed.splits[split].frames[view].camera.pose = pose;
                    frames.push(view);
                }
                Err(skipped) => lost.push(skipped),
            }
            tell(done + 1);
        }
        Self { dataset: placed, frames, lost, is_straightened }
    }
}

impl Trajectory {
    /// Poses of the frames before and after one in its recording, the nearest first.
    fn around(&self, dataset: &Dataset, entry: &FrameEntry) -> Vec<Pose> {
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

/// A finished scene that places frames.
struct Placer<'a> {
    run: &'a SceneRun,
    splats: SplatView<'a>,
    trajectory: &'a Trajectory,
    preparer: Preparer,
}

impl Placer<'_> {
    fn place(&mut self, entry: &FrameEntry, guesses: &[Pose]) -> Result<Pose, SkippedFrame> {
        let skipped = |error: FrameError| SkippedFrame::from(&error);
        let frame = entry.load().map_err(skipped)?;
        let mut observation = Observation::empty();
        self.preparer.prepare(&frame, &self.run.surface, &mut observation).map_err(skipped)?;
        let known: Vec<Pose> =
            self.trajectory.frames.values().filter_map(TrackedPose::pose).collect();
        let lost = |message: String| SkippedFrame { frame: entry.name.clone(), message };
        let found = place(self.splats, &observation, guesses, &known)
            .map_err(|loss| lost(format!("{}: not placed: {loss}", entry.name)))?;
        found.pose().ok_or_else(|| lost(format!("{}: not placed", entry.name)))
    }
}
