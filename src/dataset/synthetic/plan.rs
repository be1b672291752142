//! The splits of a procedural recording: a smooth walk that trains, viewpoints between that measure.

use super::params::{ParamsError, SyntheticParams};
use super::scene::SyntheticScene;
use super::trajectory;
use super::view::SyntheticView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use std::sync::Arc;

/// The scene and the viewpoints of each split.
pub(super) struct ViewPlan {
    pub scene: Arc<SyntheticScene>,
    pub splits: Vec<PlannedSplit>,
}

/// The viewpoints of one split.
pub(super) struct PlannedSplit {
    pub name: &'static str,
    pub poses: Vec<Pose>,
    is_noisy: bool,
}

impl PlannedSplit {
    /// Name of a frame's depth noise, `None` for exact depth.
    pub fn noise_stream(&self, frame: usize) -> Option<u64> {
        self.is_noisy.then_some(frame as u64)
    }
}

impl ViewPlan {
    /// Furnishes the room and walks the camera through it.
    pub fn new(params: &SyntheticParams) -> Result<Self, ParamsError> {
        let scene = Arc::new(SyntheticScene::new(params)?);
        let train = trajectory::train(params.n_train, params.seed);
        let mut splits =
            vec![PlannedSplit { name: "train", poses: train, is_noisy: params.depth_noise > 0.0 }];
        if params.n_eval > 0 {
            let poses = trajectory::eval(params.n_eval, params.seed);
            // Exact: what a model is measured against must not err itself.
            splits.push(PlannedSplit { name: "eval", poses, is_noisy: false });
        }
        Ok(Self { scene, splits })
    }

    /// Colour and depth of a frame of a split, noisy where the split is.
    pub fn view(&self, split: &PlannedSplit, frame: usize) -> SyntheticView {
        self.view_by(split, frame, self.scene.intrinsics())
    }

    /// As [`Self::view`] by a camera of other intrinsics at the same place.
    pub fn view_by(
        &self,
        split: &PlannedSplit,
        frame: usize,
        intrinsics: Intrinsics,
    ) -> SyntheticView {
        let camera = Camera { intrinsics, pose: split.poses[frame] };
        self.scene.sensed(&camera, split.noise_stream(frame))
    }
}
