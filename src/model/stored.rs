//! What a checkpoint holds of a model: everything needed to go on as if training had never stopped.

use super::conjugate::prior::Hyper;
use super::paper::state::ModelState;
use super::scene::state::SceneState;
use crate::math::normalization::Normalization;

/// A model of either kind.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredModel {
    /// Of the paper's preset.
    Mixture {
        /// World to model coordinates.
        normalization: Normalization,
        /// Prior and initial hyper-parameters.
        hyper: Hyper,
        /// Weights, means and statistics.
        state: ModelState,
    },
    /// Of the scene preset.
    Scene(SceneState),
}

impl StoredModel {
    /// Lets go of frames that are kept to be looked at a second time. Where several runs go on from one start,
    /// each would move what these taught, and fusing the runs would add all the motions up.
    pub fn let_go_of_kept(&mut self) {
        if let Self::Scene(state) = self {
            state.kept.clear();
        }
    }
}
