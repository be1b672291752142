//! Which scenes do not depend on the order of frames.

use super::super::{RunError, SavedRun};
use crate::export::checkpoint::StoredModel;
use crate::pipeline::settings::method::Method;
use crate::train::scene::config::{LookRule, SceneConfig};
use crate::train::scene::engine::SumForm;

/// Refuses scenes that depend on the order of frames. Mixtures do so only by what
/// [`super::same_start`] and [`crate::model::paper::merging::add`] refuse.
pub(super) fn orderless(run: &SavedRun) -> Result<(), RunError> {
    let (Method::Scene(settings), StoredModel::Scene(state)) =
        (&run.config.method, &run.content.model)
    else {
        return Ok(());
    };
    match dependence(&settings.engine, state.seeds.len()) {
        None => Ok(()),
        Some((found, advice)) => Err(RunError::Ordered { path: run.path.clone(), found, advice }),
    }
}

/// The setting by which a scene depends on the order of frames, and the one to take in its place.
fn dependence(config: &SceneConfig, components: usize) -> Option<(String, &'static str)> {
    let SceneConfig { births, refine, align, gain, looks, sums, most, .. } = config;
    if !births.is_order_invariant() {
        Some(("--births seeds".to_owned(), "--births lattice"))
    } else if *refine {
        Some(("--with refine".to_owned(), "--without refine"))
    } else if *align {
        Some(("--with align".to_owned(), "--without align"))
    } else if *gain {
        Some(("--with gain".to_owned(), "--without gain"))
    } else if *looks == LookRule::Projected {
        Some(("--visibility projected".to_owned(), "--visibility returned"))
    } else if *sums != SumForm::Mixed {
        Some((format!("sums of the form {sums:?}"), "--precision mixed"))
    } else if components >= config.most_seeds() {
        // Which components were born before it was reached depends on the order.
        Some((format!("a budget of {most} components that was reached"), "a larger --budget"))
    } else {
        None
    }
}
