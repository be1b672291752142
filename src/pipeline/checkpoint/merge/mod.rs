//! Adding the statistics of models that started alike and were trained on different frames.

mod order;
mod start;

use super::error::RunError;
use super::json::canonical;
use super::saved::{Meta, SavedRun};
use super::snapshot::now_unix_s;
use crate::export::checkpoint::{Checkpoint, Cursor, StoredModel};
use crate::model::paper::merging;
use crate::model::paper::merging::AddError;
use crate::model::paper::state::ModelState;
use crate::model::scene;
use crate::pipeline::error::SessionError;
use order::orderless;
use start::same_start;
use std::collections::BTreeSet;

/// The run that went through the frames of all: exactly the sum, so that any order of merging gives
/// the same model. The result goes on with the frames that none went through. `None` of no runs.
///
/// # Errors
/// [`RunError::Unlike`] if they did not begin alike, [`RunError::Overlap`] if a frame would count
/// twice, [`RunError::Add`] and [`RunError::Ordered`] for models that depend on the order of frames.
pub fn merge(runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    for (i, run) in runs.iter().enumerate() {
        orderless(run)?;
        for other in &runs[..i] {
            same_start(other, run)?;
            disjoint(other, run)?;
        }
    }
    let mut runs = runs.into_iter();
    let Some(first) = runs.next() else { return Ok(None) };
    runs.try_fold(first, add).map(Some)
}

fn add(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    let model = sum(&a.content.model, &b.content.model)
        .map_err(|source| RunError::Add { paths: [a.path.clone(), b.path.clone()], source })?;
    let config = a.config.whole();
    let (ours, theirs) = (a.content.cursor, b.content.cursor);
    let cursor = Cursor {
        frames: ours.frames + theirs.frames,
        points: ours.points + theirs.points,
        visited: [ours.visited, theirs.visited].concat(),
    };
    let meta = Meta {
        saved_unix_s: now_unix_s(),
        planned_frames: cursor.visited.len(),
        wall_s: a.meta.wall_s + b.meta.wall_s,
        ..a.meta
    };
    let content = Checkpoint {
        config: canonical(&config).map_err(SessionError::from)?,
        meta: canonical(&meta).map_err(SessionError::from)?,
        // The frames' reports name positions in different orders.
        history: None,
        cursor,
        model,
        ..a.content
    };
    let merged = SavedRun { config, meta, content, ..a };
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

fn disjoint(a: &SavedRun, b: &SavedRun) -> Result<(), RunError> {
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
