//! Where the camera stands: where a hand steered it, at a dataset's camera, on a path, or where training is.

use super::frame_refs::FrameRef;
use crate::math::camera_path::Keyframe;

/// Where the camera stands.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Place {
    /// Where it was steered to.
    Free,
    /// Exactly where a dataset's camera stood.
    At(FrameRef),
    /// At a moment of a camera path.
    Along(Keyframe),
}

/// What a guided camera shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum GuideStage {
    /// Nothing yet of what was opened.
    Start,
    /// Every camera of the dataset.
    Overview,
    /// What the frame at this position of the order of training shows.
    Frame(usize),
    /// The finished scene.
    End,
}
