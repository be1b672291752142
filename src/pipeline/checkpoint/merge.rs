//! Merging of runs with the same start that were trained on different frames. Mixtures have the same
//! components from the start and are added. Scenes create their components from points and are fused.

use super::error::RunError;
use super::saved::{Meta, SavedRun, canonical};
use super::snapshot::now_unix_s;
use crate::export::checkpoint::{Checkpoint, Cursor, StoredModel};
use crate::model::paper::merging;
use crate::model::paper::merging::AddError;
use crate::model::paper::state::{InitialMeans, ModelState};
use crate::pipeline::error::SessionError;
use crate::pipeline::run::RunConfig;
use serde_json::Value;
use std::collections::BTreeSet;

/// Merges runs into one run over all their frames, which can be resumed on the remaining frames. `None`
/// for an empty list.
///
/// Mixtures are added exactly, so the order and grouping of merges do not affect the model. Scenes are
/// fused, and the order of `runs` does not affect the model.
///
/// # Errors
/// [`RunError::Unlike`] if datasets, settings or initial models differ, [`RunError::Overlap`] if a
/// frame would count twice, [`RunError::Add`] for totals that cannot be added exactly.
pub fn merge(runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    if runs.first().is_some_and(|run| run.config.method.scene().is_some()) {
        return fuse(None, runs);
    }
    check_compatible(&runs)?;
    let mut runs = runs.into_iter();
    let Some(first) = runs.next() else { return Ok(None) };
    runs.try_fold(first, add).map(Some)
}

/// Merges scenes of runs that all continued the run `origin`. Components of `origin` get the statistics
/// that all runs added to them.
///
/// # Errors
/// As [`merge`], and [`RunError::Origin`] if a run does not continue `origin`.
pub fn merge_onto(origin: &SavedRun, runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    fuse(Some(origin), runs)
}

fn add(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    let model = sum(&a.content.model, &b.content.model)
        .map_err(|source| RunError::Add { paths: [a.path.clone(), b.path.clone()], source })?;
    let mut merged = combine_runs(a, b)?;
    merged.content.model = model;
    Ok(merged)
}

fn sum(a: &StoredModel, b: &StoredModel) -> Result<StoredModel, AddError> {
    use StoredModel::Mixture;
    match (a, b) {
        (Mixture { normalization, hyper, state: a }, Mixture { state: b, .. }) => {
            let totals = merging::add(&a.totals, &b.totals)?;
            let state = ModelState { totals, ..a.clone() };
            Ok(Mixture { normalization: *normalization, hyper: *hyper, state })
        }
        _ => Err(AddError::Unlike),
    }
}

fn fuse(origin: Option<&SavedRun>, mut runs: Vec<SavedRun>) -> Result<Option<SavedRun>, RunError> {
    if let Some(origin) = origin {
        for run in &mut runs {
            check_same_start(origin, run)?;
            remove_origin_frames(run, origin)?;
        }
    }
    check_compatible(&runs)?;
    // Sorted by first frame, which is unique: the result does not depend on the order of the arguments.
    runs.sort_by_key(|run| run.content.cursor.visited.iter().min().copied());
    let Some(first) = runs.first() else { return Ok(None) };
    let models: Vec<&StoredModel> = runs.iter().map(|run| &run.content.model).collect();
    let of_origin = origin.map(|run| &run.content.model);
    let Some(model) = first.config.method.as_any().fuse(of_origin, &models) else {
        let found = "components that are added instead of fused";
        return Err(origin_error(first, origin.unwrap_or(first), found));
    };
    // The origin's frames come first and count once.
    let mut runs = origin.cloned().into_iter().chain(runs);
    let Some(first) = runs.next() else { return Ok(None) };
    let mut all = runs.try_fold(first, combine_runs)?;
    all.content.model = model;
    Ok(Some(all))
}

/// Subtracts the frames, points and time of `origin` from a run that continues it.
fn remove_origin_frames(run: &mut SavedRun, origin: &SavedRun) -> Result<(), RunError> {
    use StoredModel::Scene;
    let (ours, before) = (&run.content.cursor, &origin.content.cursor);
    let Some(visited) = ours.visited.strip_prefix(before.visited.as_slice()) else {
        return Err(origin_error(run, origin, "other frames at its beginning"));
    };
    let visited = visited.to_vec();
    let (Some(frames), Some(points)) =
        (ours.frames.checked_sub(before.frames), ours.points.checked_sub(before.points))
    else {
        return Err(origin_error(run, origin, "fewer frames than the start"));
    };
    if let (Scene(now), Scene(then)) = (&run.content.model, &origin.content.model) {
        if now.components.is_some() {
            let found = "components that were merged as its budget was reached";
            return Err(origin_error(run, origin, found));
        }
        // A run that continues another only appends seeds.
        if !now.seeds.starts_with(&then.seeds) {
            return Err(origin_error(run, origin, "other components"));
        }
    }
    run.content.cursor = Cursor { frames, points, visited };
    // The origin's time counts once.
    run.meta.wall_s -= origin.meta.wall_s;
    Ok(())
}

fn origin_error(run: &SavedRun, origin: &SavedRun, found: &'static str) -> RunError {
    RunError::Origin { path: run.path.clone(), origin: origin.path.clone(), found }
}

/// Combines two runs into one run over the frames of both. The model is that of `a`.
fn combine_runs(a: SavedRun, b: SavedRun) -> Result<SavedRun, RunError> {
    // The merged run continues on all remaining frames, not on those of one shard.
    let config = a.config.without_shard();
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
        // Frame reports refer to positions in different plans.
        history: None,
        cursor,
        ..a.content
    };
    Ok(SavedRun { config, meta, content, ..a })
}

const RETRAIN_ADVICE: &str = "train them with the same settings on the same dataset";
const OTHER_ORIGIN: &str =
    "positions are relative to different origins: train them on the same dataset with this version";
const NO_REASSIGNMENT: &str =
    "reassignment made the models differ after the first frame: train them with reassign=off";

/// Returns an error for runs with different starts or a common frame.
fn check_compatible(runs: &[SavedRun]) -> Result<(), RunError> {
    for (i, run) in runs.iter().enumerate() {
        for other in runs.iter().take(i) {
            check_same_start(other, run)?;
            check_disjoint(other, run)?;
        }
    }
    Ok(())
}

/// Returns an error for runs with different datasets, settings or initial models.
fn check_same_start(a: &SavedRun, b: &SavedRun) -> Result<(), RunError> {
    let unlike = |what: &str, found: String, advice| {
        let paths = [a.path.clone(), b.path.clone()];
        Err(RunError::Unlike { paths, what: what.to_owned(), found, advice })
    };
    // Origins first: a different one also changes all poses, and with them the dataset's fingerprint.
    let origins = (a.local_origin(), b.local_origin());
    if origins.0 != origins.1 {
        return unlike("local origin", format!("{} and {}", origins.0, origins.1), OTHER_ORIGIN);
    }
    if let Some(difference) = a.meta.fingerprint.difference(&b.meta.fingerprint) {
        return unlike("dataset", format!("a difference in {difference}"), RETRAIN_ADVICE);
    }
    if a.meta.registration != b.meta.registration {
        let advice =
            "register the merged model, and remove other registrations with `register --clear`";
        return unlike("registration", "a difference".to_owned(), advice);
    }
    let (ours, theirs) = (&a.config.method, &b.config.method);
    if ours.preset() != theirs.preset() {
        let found = format!("{} and {}", ours.preset(), theirs.preset());
        return unlike("setting `preset`", found, RETRAIN_ADVICE);
    }
    // Compared before the other settings, because these estimates have clearer names here than in the
    // JSON below.
    let (ours, theirs) = (ours.as_any().world_placement(), theirs.as_any().world_placement());
    if let Some(((what, a), (_, b))) = ours.iter().zip(&theirs).find(|(a, b)| a != b) {
        return unlike(what, format!("{a} and {b}"), RETRAIN_ADVICE);
    }
    if let Some((name, found)) = different_setting(&a.config, &b.config) {
        return unlike(&format!("setting `{name}`"), found, RETRAIN_ADVICE);
    }
    match different_start(&a.content.model, &b.content.model) {
        Some((what, found, advice)) => unlike(what, found, advice),
        None => Ok(()),
    }
}

/// Returns the name and the values of the first setting that differs.
fn different_setting(a: &RunConfig, b: &RunConfig) -> Option<(String, String)> {
    let [a, b] = [a, b].map(|run| {
        let mut run = run.without_shard();
        // It may have followed from the memory of different machines.
        run.method.as_any_mut().lower_default_limit(usize::MAX);
        run
    });
    if a == b {
        return None;
    }
    let (a, b) = (serde_json::to_value(a).ok()?, serde_json::to_value(b).ok()?);
    let other = |name: &String| b.get(name).unwrap_or(&Value::Null);
    let (name, value) = a.as_object()?.iter().find(|(name, value)| other(name) != *value)?;
    Some((name.clone(), format!("{value} and {}", other(name))))
}

/// Returns the first difference between two initial models: the name of the differing property, the
/// values found, and advice.
fn different_start(
    a: &StoredModel,
    b: &StoredModel,
) -> Option<(&'static str, String, &'static str)> {
    use StoredModel::Mixture;
    let (
        Mixture { normalization, hyper, state },
        Mixture { normalization: other_normalization, hyper: other_hyper, state: other },
    ) = (a, b)
    else {
        // Scenes start empty.
        return None;
    };
    let retrain = |what, found: &str| Some((what, found.to_owned(), RETRAIN_ADVICE));
    if normalization != other_normalization {
        return retrain("range of positions", "two");
    }
    if hyper != other_hyper {
        return retrain("prior", "two");
    }
    if state.alpha_init != other.alpha_init {
        return retrain("initial weights", "two sets");
    }
    let moved = first_different_mean(&state.means, &other.means)?;
    Some(("initial means", format!("component {moved} at another position"), NO_REASSIGNMENT))
}

fn first_different_mean(a: &InitialMeans, b: &InitialMeans) -> Option<usize> {
    if a == b {
        return None;
    }
    let (a, b) = (a.rows(), b.rows());
    // Without a difference in the common rows, the first one is where the shorter list ends.
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
