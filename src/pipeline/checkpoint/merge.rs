//! Adding the statistics of models that started alike and were trained on different frames.

use super::save::now_unix_s;
use super::{Meta, RunError, SavedRun, canonical};
use crate::export::checkpoint::{Checkpoint, Cursor};
use crate::model::merging;
use crate::model::state::{Means, ModelState};
use crate::pipeline::plan::Selection;
use crate::pipeline::run::RunConfig;
use crate::pipeline::session::SessionError;
use serde_json::Value;
use std::collections::BTreeSet;

const RESTART: &str = "train them with the same settings on the same dataset";
const NO_REASSIGNMENT: &str =
    "components that move part the models after the first frame: train them with --reassign off";

/// The run that went through the frames of all: exactly the sum, so that any order of merging gives
/// the same model. The result goes on with the frames that none went through. `None` of no runs.
///
/// # Errors
/// [`RunError::Unlike`] if they did not begin alike, [`RunError::Overlap`] if a frame would count
/// twice, [`RunError::Add`] for totals that depend on the order of frames.
pub fn merge(runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    for (i, run) in runs.iter().enumerate() {
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
    let totals = merging::add(&a.content.model.totals, &b.content.model.totals)
        .map_err(|source| RunError::Add { paths: [a.path.clone(), b.path.clone()], source })?;
    let config = whole(&a.config);
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
        model: ModelState { totals, ..a.content.model },
        ..a.content
    };
    Ok(SavedRun { config, meta, content, ..a })
}

/// The settings of a run over all shards.
fn whole(config: &RunConfig) -> RunConfig {
    let selection = Selection { shard: None, max_frames: None, ..config.selection.clone() };
    RunConfig { selection, ..config.clone() }
}

fn same_start(a: &SavedRun, b: &SavedRun) -> Result<(), RunError> {
    let unlike = |what: &str, found: String, advice| {
        let paths = [a.path.clone(), b.path.clone()];
        Err(RunError::Unlike { paths, what: what.to_owned(), found, advice })
    };
    if let Some(difference) = a.meta.fingerprint.difference(&b.meta.fingerprint) {
        return unlike("dataset", format!("a difference in {difference}"), RESTART);
    }
    if let Some((name, a, b)) = different_setting(&whole(&a.config), &whole(&b.config)) {
        return unlike(&format!("setting `{name}`"), format!("{a} and {b}"), RESTART);
    }
    if a.content.normalization != b.content.normalization {
        return unlike("range of positions", "two".to_owned(), RESTART);
    }
    if a.content.hyper != b.content.hyper {
        return unlike("prior", "two".to_owned(), RESTART);
    }
    let (ours, theirs) = (&a.content.model, &b.content.model);
    if ours.alpha_init != theirs.alpha_init {
        return unlike("initial weights", "two sets".to_owned(), RESTART);
    }
    match first_moved(&ours.means, &theirs.means) {
        None => Ok(()),
        Some(k) => unlike("initial means", format!("component {k} elsewhere"), NO_REASSIGNMENT),
    }
}

/// Name of the first setting that differs, and both values.
fn different_setting(a: &RunConfig, b: &RunConfig) -> Option<(String, Value, Value)> {
    if a == b {
        return None;
    }
    let (a, b) = (serde_json::to_value(a).ok()?, serde_json::to_value(b).ok()?);
    let mut settings = a.as_object()?.iter();
    let (name, value) = settings.find(|(name, value)| b[name.as_str()] != **value)?;
    Some((name.clone(), value.clone(), b[name.as_str()].clone()))
}

/// The first component whose initial mean differs.
fn first_moved(a: &Means, b: &Means) -> Option<usize> {
    if a == b {
        return None;
    }
    let (a, b) = (a.rows(), b.rows());
    Some(a.iter().zip(&b).position(|(a, b)| a != b).unwrap_or(a.len().min(b.len())))
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
