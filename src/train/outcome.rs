//! What one frame did to a model.

use super::timing::StageMs;
use serde::{Deserialize, Serialize};

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
    /// How its photograph compared with the scene, where photographs are learnt and showed any of it.
    pub photograph: Option<PhotographOutcome>,
    /// Where the time went.
    pub ms: StageMs,
}

/// A photograph beside the picture that was drawn before it was learnt: an honest score, since the frame
/// was never seen.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotographOutcome {
    /// Root mean square difference over the channels of covered pixels, colour units.
    pub difference: f64,
    /// What the frames before differed by.
    pub usual: f64,
    /// Whether it differed so much more that nothing was learnt from its picture.
    pub contradicts: bool,
}
