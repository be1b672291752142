//! Fusion of scenes with components born from points.

use super::super::error::RunError;
use super::super::saved::SavedRun;
use super::start::{check_compatible, check_same_start};
use super::union::combine_runs;
use crate::export::checkpoint::{Cursor, StoredModel};

/// Fuses runs into one over the frames of all. `origin` is the run that all of them continued, if any. `None`
/// for an empty list.
pub(super) fn fuse(
    origin: Option<&SavedRun>,
    mut runs: Vec<SavedRun>,
) -> Result<Option<SavedRun>, RunError> {
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
    let mut runs = origin.cloned().into_iter().chain(runs);
    let Some(first) = runs.next() else { return Ok(None) };
    let mut all = runs.try_fold(first, combine_runs)?;
    all.content.model = model;
    Ok(Some(all))
}

/// Removes the frames that `origin` had already visited from a run's cursor.
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
        if !now.seeds.starts_with(&then.seeds) {
            return Err(origin_error(run, origin, "other components"));
        }
    }
    run.content.cursor = Cursor { frames, points, visited };
    run.meta.wall_s -= origin.meta.wall_s;
    Ok(())
}

fn origin_error(run: &SavedRun, origin: &SavedRun, found: &'static str) -> RunError {
    RunError::Origin { path: run.path.clone(), origin: origin.path.clone(), found }
}
