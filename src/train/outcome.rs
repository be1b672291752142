//! What one frame did to a model.

use super::timing::StageMs;

/// What one frame did to a model. A preset that never does one of these leaves it 0.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Points learnt from.
    pub points: usize,
    /// Mean of the points' ELBO under the initial model, nats; 0 without points.
    pub elbo_mean: f64,
    /// Components that came into being.
    pub born: usize,
    /// Unused components that moved to badly explained points.
    pub reassigned: usize,
    /// Components that became part of others.
    pub merged: usize,
    /// Where the time went.
    pub ms: StageMs,
}
