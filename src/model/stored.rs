//! Model state stored in a checkpoint: everything needed to resume training exactly.

use super::conjugate::prior::Hyper;
use super::paper::state::ModelState;
use super::scene::state::SceneState;
use crate::math::normalization::Normalization;

/// Model of either preset.
#[derive(Clone, Debug, PartialEq)]
pub enum StoredModel {
    /// Model of the `paper` preset.
    Mixture {
        /// Transform from world to model coordinates.
        normalization: Normalization,
        /// Prior and initial hyper-parameters.
        hyper: Hyper,
        /// Weights, means and statistics.
        state: ModelState,
    },
    /// Model of the `scene` preset.
    Scene(SceneState),
}

impl StoredModel {
    /// Drops the stored frames that await a second alignment. If several runs continue from one start, each
    /// would move the contributions of these frames, and fusion would add up all the motions.
    pub fn drop_stored_frames(&mut self) {
        if let Self::Scene(state) = self {
            state.stored_frames.clear();
        }
    }
}
