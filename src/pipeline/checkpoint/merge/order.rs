//! Which models do not depend on the order of frames.

use super::super::error::RunError;
use super::super::saved::SavedRun;
use crate::model::stored::StoredModel;

/// Refuses scenes that depend on the order of frames. Mixtures do so only by what
/// [`super::start::same_start`] and [`crate::model::paper::merging::add`] refuse.
pub(super) fn orderless(run: &SavedRun) -> Result<(), RunError> {
    let components = match &run.content.model {
        StoredModel::Scene(state) => state.seeds.len(),
        StoredModel::Mixture { state, .. } => state.alpha_init.len(),
    };
    match run.config.method.any().order_dependence(components) {
        None => Ok(()),
        Some(dependence) => Err(RunError::Ordered {
            path: run.path.clone(),
            found: dependence.found,
            advice: dependence.advice,
        }),
    }
}
