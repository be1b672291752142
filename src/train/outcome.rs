//! Result of training on one frame.

use super::scene::track::TrackingLoss;
use super::timing::StageMs;
use crate::model::scene::trajectory::TrackedPose;
use serde::{Deserialize, Serialize};

/// Result of training on one frame. Fields that a preset does not use are 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Number of points trained on.
    pub points: usize,
    /// Pixels represented by these points: total added to the components' counts.
    pub evidence: u64,
    /// Mean ELBO of the points under the initial model, nats; 0 without points.
    pub elbo_mean: f64,
    /// Number of new components.
    pub new_components: usize,
    /// Number of unused components moved to badly explained points.
    pub reassigned: usize,
    /// Number of components merged into others.
    pub merged: usize,
    /// Result of pose tracking, if enabled.
    pub tracking: Option<FrameTracking>,
    /// Milliseconds by stage.
    pub ms: StageMs,
}

/// Tracking result of a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum FrameTracking {
    /// The pose was found. The frame is trained on unless it is an outlier.
    Placed(TrackedPose),
    /// The pose was not found; the frame is not trained on.
    Lost(TrackingLoss),
}

/// A photograph compared with the scene before training on it, or an outlier frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ComparedPhotograph {
    /// Number of frames trained on before this one.
    pub frame: u64,
    /// Result of the comparison.
    pub outcome: PhotographOutcome,
}

/// Comparison of a frame with the scene before training on it: a score on unseen data.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographOutcome {
    /// RMS difference from the rendering over the channels of covered pixels, colour units. For a frame
    /// rejected by its points: RMS of their colours, or the share of surfaces that it saw through.
    pub difference: f64,
    /// Running average of `difference` over earlier frames.
    pub usual: f64,
    /// Kind of outlier; `None` for an inlier.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradiction: Option<OutlierReason>,
}

/// Reason why a frame is an outlier.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum OutlierReason {
    /// The photograph differs from the rendering; its pixels are not trained on.
    Picture,
    /// The points differ in colour from their surfaces; the frame is not trained on.
    Colors,
    /// The frame saw through surfaces; it is not trained on.
    Depth,
}
