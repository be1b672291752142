//! Splits of a procedural recording: a smooth training trajectory, evaluation viewpoints between its
//! frames, and viewpoints in free space.

use super::free_views::{self, FreeRules};
use super::params::{ParamsError, PhoneScene, SyntheticCamera, SyntheticParams};
use super::phone::camera::{Capture, PhoneCamera, depth_camera};
use super::phone::drift::with_drift;
use super::phone::walk::Walk;
use super::scene::SyntheticScene;
use super::trajectory;
use super::view::SyntheticView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use std::sync::Arc;

/// Ratio of photograph to depth resolution of the room's camera in phone layouts.
const ROOM_FACTOR: u32 = 4;
/// Minimum side of the depth image, pixels.
const MIN_SIDE: u32 = 8;
/// Confidence code of exact depth.
const SURE: u8 = 2;

pub(super) struct ViewPlan {
    pub scene: Arc<SyntheticScene>,
    pub splits: Vec<PlannedSplit>,
    phone: Option<PhoneCamera>,
}

pub(super) struct PlannedSplit {
    pub name: &'static str,
    /// True poses, from which frames are rendered.
    pub poses: Vec<Pose>,
    /// Poses written to the recording; they differ from the true poses by drift.
    pub recorded_poses: Vec<Pose>,
    /// True if layouts without splits also contain these frames.
    pub is_recorded: bool,
    is_noisy: bool,
    is_of_phone: bool,
}

impl PlannedSplit {
    /// Returns a split with exact depth and true poses.
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

    /// Random stream of a frame's depth noise; `None` for exact depth.
    pub fn noise_stream(&self, frame: usize) -> Option<u64> {
        self.is_noisy.then_some(frame as u64)
    }
}

impl ViewPlan {
    /// Builds the scene and plans the viewpoints of all splits.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        let scene = Arc::new(SyntheticScene::new(params)?);
        let (train, eval, phone) = match params.camera {
            SyntheticCamera::Room => {
                let train = PlannedSplit {
                    is_recorded: true,
                    is_noisy: params.depth_noise > 0.0,
                    ..PlannedSplit::exact("train", trajectory::train(params.n_train, params.seed))
                };
                let eval = PlannedSplit {
                    is_recorded: true,
                    // Evaluation frames are ground truth, so their depth is exact.
                    ..PlannedSplit::exact("eval", trajectory::eval(params.n_eval, params.seed))
                };
                (train, eval, None)
            }
            SyntheticCamera::Phone(content) => {
                let walk = Walk::new(content, params.seed);
                let phone = PhoneCamera::new(walk, params.n_train, params.seed);
                let poses: Vec<Pose> = (0..params.n_train).map(|i| phone.pose(i)).collect();
                let train = PlannedSplit {
                    recorded_poses: with_drift(&poses, params.seed),
                    is_recorded: true,
                    is_of_phone: true,
                    ..PlannedSplit::exact("train", poses)
                };
                let between = |i: usize| walk.steady((i as f64 + 0.37) / params.n_eval as f64);
                let eval = (0..params.n_eval).map(between).collect();
                (train, PlannedSplit::exact("eval", eval), Some(phone))
            }
        };
        let free = match params.n_free {
            0 => Vec::new(),
            n => {
                let trained = Camera { intrinsics: scene.intrinsics(), pose: Pose::IDENTITY };
                free_views::choose(n, scene.room(), trained, &train.poses, &rules(params))?
            }
        };
        let mut splits = vec![train, eval, PlannedSplit::exact("free", free)];
        splits.retain(|split| !split.poses.is_empty());
        Ok(Self { scene, splits, phone })
    }

    /// Renders colour and depth of a frame, with depth noise if the split is noisy.
    pub fn render_view(&self, split: &PlannedSplit, frame: usize) -> SyntheticView {
        self.view_by(split, frame, self.scene.intrinsics())
    }

    /// As [`Self::view`], with other intrinsics at the same pose.
    pub fn view_by(
        &self,
        split: &PlannedSplit,
        frame: usize,
        intrinsics: Intrinsics,
    ) -> SyntheticView {
        let camera = Camera { intrinsics, pose: split.poses[frame] };
        self.scene.render_sensed(&camera, split.noise_stream(frame))
    }

    /// Renders a frame as a phone stores it; the depth has the intrinsics [`Self::depth_camera`].
    pub fn render_capture(&self, split: &PlannedSplit, frame: usize) -> Capture {
        let of_depth = self.depth_camera();
        if let Some(phone) = self.phone.as_ref().filter(|_| split.is_of_phone) {
            return phone.capture(&self.scene, frame, of_depth);
        }
        let depth_z = self.view_by(split, frame, of_depth).depth_z;
        let confidence = Image::filled(depth_z.width, depth_z.height, SURE);
        Capture { color: self.render_view(split, frame).color, depth_z, confidence }
    }

    /// Intrinsics of a phone's depth image: the lens of the photograph at a lower resolution.
    pub fn depth_camera(&self) -> Intrinsics {
        let k = self.scene.intrinsics();
        if self.phone.is_some() {
            return depth_camera(&k);
        }
        let side = |n: u32| (n / ROOM_FACTOR).max(MIN_SIDE);
        let (width, height) = (side(k.width), side(k.height));
        let sx = f64::from(width) / f64::from(k.width);
        let sy = f64::from(height) / f64::from(k.height);
        Intrinsics { width, height, fx: k.fx * sx, fy: k.fy * sy, cx: k.cx * sx, cy: k.cy * sy }
    }

    /// True if a phone records.
    pub fn has_phone_camera(&self) -> bool {
        self.phone.is_some()
    }
}

fn rules(params: &SyntheticParams) -> FreeRules {
    match params.camera {
        SyntheticCamera::Phone(PhoneScene::Door) => FreeRules::oblique(params.seed),
        SyntheticCamera::Phone(PhoneScene::Room) | SyntheticCamera::Room => {
            FreeRules::anywhere(params.seed)
        }
    }
}
