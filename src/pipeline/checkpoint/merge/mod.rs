//! Models that started alike and were trained on different frames, as one: those whose components are
//! the same from the beginning are added, scenes whose components were born from points are fused.

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
use order::orderless;
use start::compatible;
use union::together;

/// The run that went through the frames of all. Components that are the same from the beginning are
/// added, exactly, so that any order and tree of merging gives the same model; scenes with seeds are
/// fused, to the same model for any order of `runs`. The result goes on with the frames that none went
/// through. `None` of no runs.
///
/// # Errors
/// [`RunError::Unlike`] if they did not begin alike, [`RunError::Overlap`] if a frame would count
/// twice, [`RunError::Add`] and [`RunError::Ordered`] for models that depend on the order of frames.
pub fn merge(runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    if runs.first().is_some_and(|run| run.config.method.any().is_fused()) {
        return fuse(None, runs);
    }
    runs.iter().try_for_each(orderless)?;
    compatible(&runs)?;
    let mut runs = runs.into_iter();
    let Some(first) = runs.next() else { return Ok(None) };
    runs.try_fold(first, add).map(Some)
}

/// Like [`merge`], of scenes with seeds that all went on from `origin`: what each learnt of the components
/// that they had in common is added to these.
///
/// # Errors
/// As [`merge`], and [`RunError::Origin`] unless all went on from `origin`.
pub fn merge_onto(origin: &SavedRun, runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    fuse(Some(origin), runs)
}

fn add(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    let model = sum(&a.content.model, &b.content.model)
        .map_err(|source| RunError::Add { paths: [a.path.clone(), b.path.clone()], source })?;
    let mut merged = together(a, b)?;
    merged.content.model = model;
    orderless(&merged)?;
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
