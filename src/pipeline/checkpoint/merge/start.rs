//! Checks that runs started alike.

use super::super::error::RunError;
use super::super::saved::SavedRun;
use crate::export::checkpoint::StoredModel;
use crate::model::paper::state::InitialMeans;
use crate::pipeline::run::RunConfig;
use crate::pipeline::settings::method::Method;
use serde_json::Value;
use std::collections::BTreeSet;

const RETRAIN_ADVICE: &str = "train them with the same settings on the same dataset";
const OTHER_ORIGIN: &str =
    "positions are relative to different origins: train them on the same dataset with this version";
const NO_REASSIGNMENT: &str =
    "reassignment made the models differ after the first frame: train them with --reassign off";

struct Difference {
    what: String,
    found: String,
    advice: &'static str,
}

impl Difference {
    fn new(what: &str, found: impl Into<String>) -> Self {
        Self { what: what.to_owned(), found: found.into(), advice: RETRAIN_ADVICE }
    }
}

/// Refuses runs that did not start alike or have a frame in common.
pub(super) fn check_compatible(runs: &[SavedRun]) -> Result<(), RunError> {
    for (i, run) in runs.iter().enumerate() {
        for other in runs.iter().take(i) {
            check_same_start(other, run)?;
            check_disjoint(other, run)?;
        }
    }
    Ok(())
}

/// Refuses runs with different datasets, settings or initial models.
pub(super) fn check_same_start(a: &SavedRun, b: &SavedRun) -> Result<(), RunError> {
    let difference = of_origins(a, b)
        .or_else(|| of_datasets(a, b))
        .or_else(|| of_methods(&a.config.method, &b.config.method))
        .or_else(|| of_settings(&a.config.without_shard(), &b.config.without_shard()))
        .or_else(|| of_models(&a.content.model, &b.content.model));
    match difference {
        None => Ok(()),
        Some(Difference { what, found, advice }) => {
            let paths = [a.path.clone(), b.path.clone()];
            Err(RunError::Unlike { paths, what, found, advice })
        }
    }
}

/// Compared first, because a different local origin also changes all poses.
fn of_origins(a: &SavedRun, b: &SavedRun) -> Option<Difference> {
    let (a, b) = (a.local_origin(), b.local_origin());
    (a != b).then(|| Difference {
        advice: OTHER_ORIGIN,
        ..Difference::new("local origin", format!("{a} and {b}"))
    })
}

fn of_datasets(a: &SavedRun, b: &SavedRun) -> Option<Difference> {
    let difference = a.meta.fingerprint.difference(&b.meta.fingerprint)?;
    Some(Difference::new("dataset", format!("a difference in {difference}")))
}

/// Compares presets and the settings that position models in the world.
fn of_methods(a: &Method, b: &Method) -> Option<Difference> {
    if a.preset() != b.preset() {
        let found = format!("{} and {}", a.preset(), b.preset());
        return Some(Difference::new("setting `preset`", found));
    }
    let (a, b) = (a.as_any().world_placement(), b.as_any().world_placement());
    let ((what, a), (_, b)) = a.iter().zip(&b).find(|(a, b)| a != b)?;
    Some(Difference::new(what, format!("{a} and {b}")))
}

/// Returns the first setting that differs.
fn of_settings(a: &RunConfig, b: &RunConfig) -> Option<Difference> {
    if a == b {
        return None;
    }
    let (a, b) = (serde_json::to_value(a).ok()?, serde_json::to_value(b).ok()?);
    let mut settings = a.as_object()?.iter();
    let other = |name: &String| b.get(name).unwrap_or(&Value::Null);
    let (name, value) = settings.find(|(name, value)| other(name) != *value)?;
    let found = format!("{value} and {}", other(name));
    Some(Difference::new(&format!("setting `{name}`"), found))
}

/// Compares initial mixtures; scenes start empty.
fn of_models(a: &StoredModel, b: &StoredModel) -> Option<Difference> {
    use StoredModel::Mixture;
    let (
        Mixture { normalization, hyper, state },
        Mixture { normalization: other_normalization, hyper: other_hyper, state: other },
    ) = (a, b)
    else {
        return None;
    };
    if normalization != other_normalization {
        return Some(Difference::new("range of positions", "two"));
    }
    if hyper != other_hyper {
        return Some(Difference::new("prior", "two"));
    }
    if state.alpha_init != other.alpha_init {
        return Some(Difference::new("initial weights", "two sets"));
    }
    let moved = first_different_mean(&state.means, &other.means)?;
    let found = format!("component {moved} at another position");
    Some(Difference { advice: NO_REASSIGNMENT, ..Difference::new("initial means", found) })
}

/// Index of the first component whose initial mean differs.
fn first_different_mean(a: &InitialMeans, b: &InitialMeans) -> Option<usize> {
    if a == b {
        return None;
    }
    let (a, b) = (a.rows(), b.rows());
    Some(a.iter().zip(&b).position(|(a, b)| a != b).unwrap_or(a.len().min(b.len())))
}

fn check_disjoint(a: &SavedRun, b: &SavedRun) -> Result<(), RunError> {
    let (ours, theirs) = (&a.content.cursor.visited, &b.content.cursor.visited);
    let ours: BTreeSet<u32> = ours.iter().copied().collect();
    let mut in_both = theirs.iter().filter(|frame| ours.contains(frame));
    match in_both.next() {
        None => Ok(()),
        Some(&first) => Err(RunError::Overlap {
            paths: [a.path.clone(), b.path.clone()],
            n_frames: 1 + in_both.count(),
            first,
        }),
    }
}
