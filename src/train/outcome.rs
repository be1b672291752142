//! What one frame did to a model.

use super::scene::track::TrackingLoss;
use super::timing::StageMs;
use crate::model::scene::trajectory::TrackedPose;
use serde::{Deserialize, Serialize};

/// What one frame did to a model. A preset that never does one of these leaves it 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Points learnt from.
    pub points: usize,
    /// Pixels that these points stand for: what they add to the counts of components.
    pub evidence: u64,
    /// Mean of the points' ELBO under the initial model, nats; 0 without points.
    pub elbo_mean: f64,
    /// Components that came into being.
    pub born: usize,
    /// Unused components that moved to badly explained points.
    pub reassigned: usize,
    /// Components that became part of others.
    pub merged: usize,
    /// Where its camera was found, where poses are tracked.
    pub tracking: Option<FrameTracking>,
    /// Where the time went.
    pub ms: StageMs,
}

/// What tracking made of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameTracking {
    /// It was placed, and learnt unless it contradicts the scene.
    Placed(TrackedPose),
    /// It could not be placed: nothing was learnt from it.
    Lost(TrackingLoss),
}

/// A photograph that was compared with the scene before it was learnt, or a frame that contradicts it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedPhotograph {
    /// Frames learnt before its own.
    pub frame: u64,
    /// How it compared.
    pub outcome: PhotographOutcome,
}

/// A frame beside the scene as it was before: an honest score, since the frame was never seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographOutcome {
    /// Root mean square difference from the picture drawn, over the channels of covered pixels, colour
    /// units. Of a frame that contradicts by its points: that of their colours, or the share of surfaces
    /// that it saw through.
    pub difference: f64,
    /// What it was in the frames before.
    pub usual: f64,
    /// What it contradicts the scene by, if it does.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradiction: Option<Contradiction>,
}

/// How a frame contradicts what the frames before it have shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Contradiction {
    /// Its photograph differs from the picture: nothing was learnt from its pixels.
    Picture,
    /// Its points have other colours than their surfaces: nothing was learnt from it.
    Colors,
    /// It saw through surfaces: nothing was learnt from it.
    Depth,
}
