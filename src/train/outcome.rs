//! What one frame did to a model.

use super::timing::StageMs;

/// What one frame did to the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Points learnt from.
    pub points: usize,
    /// Mean of the points' ELBO under the initial model; 0 without points.
    pub elbo_mean: f64,
    /// Components that moved.
    pub reassigned: usize,
    /// Where the time went.
    pub ms: StageMs,
}
