//! Check that a model does not depend on the order of frames.

use super::super::error::RunError;
use super::super::saved::SavedRun;
use crate::model::attributes::StoredModel;

/// Refuses scenes that depend on the order of frames. For mixtures, [`super::check_same_start`] and
/// [`crate::model::paper::merging::add`] detect the dependence.
pub(super) fn check_order_independent(run: &SavedRun) -> Result<(), RunError> {
    let components = match &run.content.model {
        StoredModel::Scene(state) => state.seeds.len(),
        StoredModel::Mixture { state, .. } => state.alpha_init.len(),
    };
    match run.config.method.as_any().order_dependence(components) {
        None => Ok(()),
        Some(dependence) => Err(RunError::Ordered {
            path: run.path.clone(),
            found: dependence.found,
            advice: dependence.advice,
        }),
    }
}
