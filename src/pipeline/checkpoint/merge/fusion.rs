//! Scenes whose components were born from points, as one.

use super::super::error::RunError;
use super::super::saved::SavedRun;
use super::start::{compatible, same_start};
use super::union::together;
use crate::export::checkpoint::{Cursor, StoredModel};

/// The run that went through the frames of all, which went on from `origin` if there is one. `None` of no
/// runs.
pub(super) fn fuse(
    origin: Option<&SavedRun>,
    mut runs: Vec<SavedRun>,
) -> Result<Option<SavedRun>, RunError> {
    if let Some(origin) = origin {
        for run in &mut runs {
            same_start(origin, run)?;
            leave_own_frames(run, origin)?;
        }
    }
    compatible(&runs)?;
    // No two have a frame in common: whatever the order of the arguments was, this is one.
    runs.sort_by_key(|run| run.content.cursor.visited.iter().min().copied());
    let Some(first) = runs.first() else { return Ok(None) };
    let models: Vec<&StoredModel> = runs.iter().map(|run| &run.content.model).collect();
    let of_origin = origin.map(|run| &run.content.model);
    let Some(model) = first.config.method.any().fuse(of_origin, &models) else {
        let found = "components that are added without it";
        return Err(not_from(first, origin.unwrap_or(first), found));
    };
    let mut runs = origin.cloned().into_iter().chain(runs);
    let Some(first) = runs.next() else { return Ok(None) };
    let mut all = runs.try_fold(first, together)?;
    all.content.model = model;
    Ok(Some(all))
}

/// Takes from a run's frames those that `origin` went through before it.
fn leave_own_frames(run: &mut SavedRun, origin: &SavedRun) -> Result<(), RunError> {
    use StoredModel::Scene;
    let (ours, before) = (&run.content.cursor, &origin.content.cursor);
    let Some(visited) = ours.visited.strip_prefix(before.visited.as_slice()) else {
        return Err(not_from(run, origin, "other frames at its beginning"));
    };
    let visited = visited.to_vec();
    let (Some(frames), Some(points)) =
        (ours.frames.checked_sub(before.frames), ours.points.checked_sub(before.points))
    else {
        return Err(not_from(run, origin, "fewer frames than that has"));
    };
    if let (Scene(now), Scene(then)) = (&run.content.model, &origin.content.model) {
        if now.components.is_some() {
            let found = "components that were merged as its budget was reached";
            return Err(not_from(run, origin, found));
        }
        if !now.seeds.starts_with(&then.seeds) {
            return Err(not_from(run, origin, "other components"));
        }
    }
    run.content.cursor = Cursor { frames, points, visited };
    run.meta.wall_s -= origin.meta.wall_s;
    Ok(())
}

fn not_from(run: &SavedRun, origin: &SavedRun, found: &'static str) -> RunError {
    RunError::Origin { path: run.path.clone(), origin: origin.path.clone(), found }
}
