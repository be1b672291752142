//! Position of the view: steered freely, at a dataset camera, on a path, or guided by training.

use super::frame_refs::FrameRef;
use crate::math::camera_path::Keyframe;

/// Position of the view.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum ViewPosition {
    /// Steered freely.
    Free,
    /// Exactly at a dataset camera.
    At(FrameRef),
    /// At a keyframe of a camera path.
    Along(Keyframe),
}

/// Stage of the guided camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuideStage {
    /// Nothing of the subject is shown yet.
    Start,
    /// All cameras of the dataset.
    Overview,
    /// Camera of the frame at this position in training order.
    Frame(usize),
    /// The finished scene.
    End,
}
