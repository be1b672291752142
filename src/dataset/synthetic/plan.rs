//! Splits of a procedural recording: a smooth training trajectory, evaluation viewpoints between its
//! frames, and viewpoints in free space.

use super::free_views;
use super::free_views::FreeRules;
use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::phone::camera::{Capture, PhoneCamera, depth_camera};
use super::phone::walk::{Walk, with_drift};
use super::scene::SyntheticScene;
use super::view::SyntheticView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec3, dvec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Ratio of photograph resolution to depth resolution of the room's camera, in the layouts of phone
/// apps.
const ROOM_FACTOR: u32 = 4;
const MIN_SIDE: u32 = 8;
const SURE: u8 = 2;

/// Frame rate of the simulated recorder, hertz.
pub(super) const FRAMES_PER_SECOND: f64 = 30.0;
/// Time stamp of the first frame, seconds.
const START: f64 = 1000.0;

/// Viewpoints of all splits of a procedural recording, with the scene and its cameras.
pub struct ViewPlan {
    pub(super) scene: Arc<SyntheticScene>,
    pub(super) splits: Vec<PlannedSplit>,
    phone: Option<PhoneCamera>,
}

pub(super) struct PlannedSplit {
    pub name: &'static str,
    pub poses: Vec<Pose>,
    /// Poses written to the recording. The phone's poses are the true poses with drift; others are
    /// exact.
    recorded_poses: Vec<Pose>,
    /// True if layouts without splits (such as TUM) also contain the frames of this split.
    pub is_recorded: bool,
    is_noisy: bool,
    is_of_phone: bool,
}

impl PlannedSplit {
    fn exact(name: &'static str, poses: Vec<Pose>) -> Self {
        let stated = poses.clone();
        Self {
            name,
            poses,
            recorded_poses: stated,
            is_recorded: false,
            is_noisy: false,
            is_of_phone: false,
        }
    }

    pub fn noise_stream(&self, frame: usize) -> Option<u64> {
        self.is_noisy.then_some(frame as u64)
    }
}

impl ViewPlan {
    /// Builds the scene and plans the viewpoints of all splits.
    ///
    /// # Errors
    /// Fails for parameters outside their range, or for a scene without enough free space for the free
    /// views.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        // Shared by all frames of a dataset, because its light maps are large.
        let scene = Arc::new(SyntheticScene::new(params)?);
        let (train, eval, phone) = match params.camera {
            SyntheticCamera::Room => {
                let train = PlannedSplit {
                    is_recorded: true,
                    is_noisy: params.depth_noise > 0.0,
                    ..PlannedSplit::exact("train", train(params.n_train, params.seed))
                };
                let eval = PlannedSplit {
                    is_recorded: true,
                    // Evaluation frames are ground truth, so their depth is exact.
                    ..PlannedSplit::exact("eval", eval(params.n_eval, params.seed))
                };
                (train, eval, None)
            }
            SyntheticCamera::Phone(content) => {
                let walk = Walk::new(content, params.seed);
                let phone = PhoneCamera::new(walk, params.n_train, params.seed);
                let poses: Vec<Pose> = (0..params.n_train).map(|i| phone.pose(i)).collect();
                let train = PlannedSplit {
                    // As a phone's tracking states them.
                    recorded_poses: with_drift(&poses, params.seed),
                    is_recorded: true,
                    is_of_phone: true,
                    ..PlannedSplit::exact("train", poses)
                };
                // The offset avoids training viewpoints at the usual frame counts.
                let between = |i: usize| walk.steady((i as f64 + 0.37) / params.n_eval as f64);
                let eval = (0..params.n_eval).map(between).collect();
                (train, PlannedSplit::exact("eval", eval), Some(phone))
            }
        };
        let free = match params.n_free {
            0 => Vec::new(),
            n => {
                let trained = Camera { intrinsics: scene.intrinsics(), pose: Pose::IDENTITY };
                let rules = FreeRules::new(params.camera, params.seed);
                free_views::choose(n, scene.room(), trained, &train.poses, &rules)?
            }
        };
        let mut splits = vec![train, eval, PlannedSplit::exact("free", free)];
        // Splits are never empty, so that code may take the first frame of one.
        splits.retain(|split| !split.poses.is_empty());
        Ok(Self { scene, splits, phone })
    }

    /// Returns the frames of all recorded splits in order, for layouts without splits.
    pub fn recorded_frames(&self) -> impl Iterator<Item = RecordedFrame<'_>> {
        let recorded = self.splits.iter().filter(|split| split.is_recorded);
        let frames = recorded.flat_map(|split| {
            split.recorded_poses.iter().enumerate().map(move |(i, pose)| (split, i, *pose))
        });
        frames.enumerate().map(move |(index, (split, in_split, pose))| {
            let time = START + index as f64 / FRAMES_PER_SECOND;
            RecordedFrame { index, time, pose, plan: self, split, in_split }
        })
    }

    /// Returns the intrinsics of every photograph.
    pub fn photo_camera(&self) -> Intrinsics {
        self.scene.intrinsics()
    }

    /// True if there are splits that layouts without splits do not contain.
    pub fn has_unrecorded_splits(&self) -> bool {
        self.splits.iter().any(|split| !split.is_recorded)
    }

    pub(super) fn render_view(&self, split: &PlannedSplit, frame: usize) -> SyntheticView {
        self.view_by(split, frame, self.scene.intrinsics())
    }

    fn view_by(&self, split: &PlannedSplit, frame: usize, intrinsics: Intrinsics) -> SyntheticView {
        let camera = Camera { intrinsics, pose: split.poses[frame] };
        self.scene.render_sensed(&camera, split.noise_stream(frame))
    }

    /// Renders a frame in the form in which a phone stores it. Its depth has the intrinsics
    /// [`Self::depth_camera`].
    fn render_capture(&self, split: &PlannedSplit, frame: usize) -> Capture {
        let of_depth = self.depth_camera();
        if let Some(phone) = self.phone.as_ref().filter(|_| split.is_of_phone) {
            return phone.capture(&self.scene, frame, of_depth);
        }
        let depth_z = self.view_by(split, frame, of_depth).depth_z;
        // Only the lidar of the phone has doubtful pixels.
        let confidence = Image::filled(depth_z.width, depth_z.height, SURE);
        Capture { color: self.render_view(split, frame).color, depth_z, confidence }
    }

    /// Returns the intrinsics of a phone's depth image: the photograph's lens at a lower resolution.
    pub fn depth_camera(&self) -> Intrinsics {
        let k = self.scene.intrinsics();
        if self.phone.is_some() {
            return depth_camera(&k);
        }
        // Both sides by one factor: one lens gives images of one shape.
        let factor = ROOM_FACTOR.min(k.width.min(k.height) / MIN_SIDE).max(1);
        k.resized(k.width / factor, k.height / factor)
    }

    pub(super) fn has_phone_camera(&self) -> bool {
        self.phone.is_some()
    }
}

/// One frame of a recording.
pub struct RecordedFrame<'a> {
    /// Index over all recorded splits, from 0.
    pub index: usize,
    /// Time stamp, seconds.
    pub time: f64,
    /// Camera-to-world pose as stated by the recording, metres. The phone's poses have drift.
    pub pose: Pose,
    plan: &'a ViewPlan,
    split: &'a PlannedSplit,
    in_split: usize,
}

impl RecordedFrame<'_> {
    /// Renders colour and depth, both with the camera of the photographs.
    pub fn view(&self) -> SyntheticView {
        self.plan.render_view(self.split, self.in_split)
    }

    /// Renders colour with the camera of the photographs, and depth with [`ViewPlan::depth_camera`].
    pub fn capture(&self) -> Capture {
        self.plan.render_capture(self.split, self.in_split)
    }

    /// Renders colour with the camera of the photographs, and depth with the intrinsics `depth` at the
    /// same pose.
    pub fn view_by(&self, depth: Intrinsics) -> SyntheticView {
        let of_depth = self.plan.view_by(self.split, self.in_split, depth);
        SyntheticView { color: self.view().color, ..of_depth }
    }
}

/// Number of frames per turn around the room. Longer trajectories make more turns, at varying heights.
const FRAMES_PER_TURN: f64 = 48.0;
/// Semi-axes of the elliptic camera path, metres.
const PATH: [f64; 2] = [1.75, 1.45];
/// Mean and amplitude of the camera height, metres.
const HEIGHT: [f64; 2] = [1.4, 0.3];
/// Mean of the points that the camera faces, metres.
const TARGET: DVec3 = dvec3(0.0, 0.0, 0.85);
/// Random stream of the trajectory's phase, distinct from the streams of frames and furnishing.
const PHASE: u64 = u64::MAX - 1;

pub(super) fn train(n_frames: usize, seed: u64) -> Vec<Pose> {
    // Whole turns close the path.
    let turns = (n_frames as f64 / FRAMES_PER_TURN).round().max(1.0);
    let phase = phase(seed);
    (0..n_frames).filter_map(|i| pose(phase + turns * i as f64 / n_frames as f64, turns)).collect()
}

/// Returns the poses of the evaluation frames. Their radius and heights differ from those of the
/// training frames.
pub(super) fn eval(n_frames: usize, seed: u64) -> Vec<Pose> {
    // The offset avoids training viewpoints at the usual frame counts.
    let phase = phase(seed) + 0.37 / FRAMES_PER_TURN;
    let between = |i: usize| {
        let turn = phase + i as f64 / n_frames as f64;
        let eye = path_position(turn, 0.93, HEIGHT[0] + 0.2 * (TAU * 3.0 * turn).sin());
        Pose::look_at(eye, target(turn + 0.11), DVec3::Z)
    };
    (0..n_frames).filter_map(between).collect()
}

fn phase(seed: u64) -> f64 {
    // Seed 0 is the demo, whose first view was chosen by hand.
    if seed == 0 { 0.89 } else { Rng::new(seed, Purpose::Synthetic, PHASE).uniform() }
}

/// Returns the pose after `turn` turns on a path of `turns` turns. It is never `None`, because the path
/// avoids the vertical through the target.
fn pose(turn: f64, turns: f64) -> Option<Pose> {
    // One more swing than turns: heights differ between turns, and the path still closes.
    let swing = (TAU * turn * (1.0 + 1.0 / turns)).sin();
    let eye = path_position(turn, 1.0, HEIGHT[0] + HEIGHT[1] * swing);
    Pose::look_at(eye, target(turn), DVec3::Z)
}

fn path_position(turn: f64, reach: f64, height: f64) -> DVec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    dvec3(PATH[0] * reach * cos, PATH[1] * reach * sin, height)
}

/// Returns the point that the camera faces. It oscillates, so that floor and ceiling become visible as
/// well.
fn target(turn: f64) -> DVec3 {
    let sway = TAU * turn;
    TARGET + dvec3(0.25 * (2.0 * sway).sin(), 0.2 * (3.0 * sway).cos(), 0.35 * (5.0 * sway).sin())
}

#[cfg(test)]
mod trajectory_tests {
    use super::super::room::{FurnishedRoom, HI, LO};
    use super::*;

    #[test]
    fn cameras_stand_in_free_space() {
        let room = FurnishedRoom::new(3);
        let poses = [train(96, 0), eval(24, 0), train(1, 5), eval(1, 5), train(7, 9)].concat();
        assert_eq!(poses.len(), 96 + 24 + 1 + 1 + 7, "every frame has a pose");
        for pose in poses {
            let eye = pose.centre();
            assert!(eye.cmpgt(LO).all() && eye.cmplt(HI).all(), "{eye}");
            for solid in &room.solids[1..] {
                let (lo, hi) = solid.shape.bounds();
                let outside = (lo - eye).max(eye - hi).max_element();
                assert!(outside > 0.15, "{eye} is {outside} m from {solid:?}");
            }
        }
    }
}
