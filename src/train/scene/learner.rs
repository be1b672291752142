//! Interface of a scene trainer beyond that of all trainers.

use crate::model::scene::splat_rule::SplatRule;
use crate::observation::surface::Observation;
use crate::train::learner::Learns;

/// Scene trainer whose form of sums was chosen at run time.
pub trait SceneLearner: Learns<Observation> {
    /// Sets the splat rule from now on.
    fn set_splat_rule(&mut self, rule: SplatRule);
}
