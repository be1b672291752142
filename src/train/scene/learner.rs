//! What a scene's learner can do besides what all learners can.

use crate::model::scene::splat_rule::SplatRule;
use crate::observation::surface::Observation;
use crate::train::learner::Learns;

/// A scene; the form of its sums was chosen at run time.
pub trait SceneLearner: Learns<Observation> {
    /// Draws components by another rule from now on.
    fn set_splat_rule(&mut self, rule: SplatRule);
}
