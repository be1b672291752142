//! Merging of runs that started alike and were trained on different frames. Models with identical initial
//! components are added; scenes with components born from points are fused.

mod fusion;
mod order;
mod start;
mod union;

use super::error::RunError;
use super::saved::SavedRun;
use crate::export::checkpoint::StoredModel;
use crate::model::paper::merging;
use crate::model::paper::merging::AddError;
use crate::model::paper::state::ModelState;
use crate::model::scene;
use fusion::fuse;
use order::check_order_independent;
use start::check_compatible;
use union::combine_runs;

/// Merges runs into one over the frames of all. Models with identical initial components are added exactly,
/// so any order and tree of merges gives the same model. Scenes with seeds are fused, to the same model for
/// any order of `runs`. The result can be resumed on the remaining frames. `None` for an empty list.
///
/// # Errors
/// [`RunError::Unlike`] if they did not start alike, [`RunError::Overlap`] if a frame would count twice,
/// [`RunError::Add`] and [`RunError::Ordered`] for models that depend on the order of frames.
pub fn merge(runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    if runs.first().is_some_and(|run| run.config.method.as_any().is_fused()) {
        return fuse(None, runs);
    }
    runs.iter().try_for_each(check_order_independent)?;
    check_compatible(&runs)?;
    let mut runs = runs.into_iter();
    let Some(first) = runs.next() else { return Ok(None) };
    runs.try_fold(first, add).map(Some)
}

/// Merges scenes with seeds that all continued `origin`: statistics of their common components are added to
/// those of `origin`.
///
/// # Errors
/// As [`merge`], and [`RunError::Origin`] unless all continued `origin`.
pub fn merge_onto(origin: &SavedRun, runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    fuse(Some(origin), runs)
}

fn add(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    let model = sum(&a.content.model, &b.content.model)
        .map_err(|source| RunError::Add { paths: [a.path.clone(), b.path.clone()], source })?;
    let mut merged = combine_runs(a, b)?;
    merged.content.model = model;
    check_order_independent(&merged)?;
    Ok(merged)
}

fn sum(a: &StoredModel, b: &StoredModel) -> Result<StoredModel, AddError> {
    use StoredModel::{Mixture, Scene};
    match (a, b) {
        (Mixture { normalization, hyper, state: a }, Mixture { state: b, .. }) => {
            let totals = merging::add(&a.totals, &b.totals)?;
            let state = ModelState { totals, ..a.clone() };
            Ok(Mixture { normalization: *normalization, hyper: *hyper, state })
        }
        (Scene(a), Scene(b)) => Ok(Scene(scene::merging::add(a, b)?)),
        _ => Err(AddError::Unlike),
    }
}
