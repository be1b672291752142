//! Tracked poses in commands.

use super::failure::Failure;
use super::output;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::pose_check::PoseCheck;
use vbgs_studio::eval::choices::Views;
use vbgs_studio::eval::trajectory_error::TrajectoryError;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::tracked::{PlacedViews, Trajectory};

/// Finds the poses of a dataset's views by tracking them against the scene. Returns `None` for models of
/// presets other than `scene`.
///
/// # Errors
/// The pose of no view could be found.
pub fn place(
    dataset: &Dataset,
    method: &Method,
    splats: &SplatSet,
    trajectory: &Trajectory,
    views: Views<'_>,
) -> Result<Option<PlacedViews>, Failure> {
    // Views are aligned with the components of a scene; `paper` has no such alignment.
    let Some(run) = method.scene() else { return Ok(None) };
    let bar = output::bar(views.1.len(), "view");
    let tell = |done| bar.set_position(done as u64);
    let placed = PlacedViews::find(dataset, (run, splats.view()), trajectory, views, tell);
    bar.finish_and_clear();
    if placed.is_straightened {
        note!(
            "note: photographs are corrected for rolling shutter and timestamps using the recorded poses, as without --poses track"
        );
    }
    placed.lost.iter().for_each(|lost| note!("warning: {}", lost.message));
    match placed.lost.first() {
        Some(first) if placed.frames.is_empty() => Err(failed!(
            "{}: expected the scene to place at least one of {} views, found none; the first: {}",
            dataset.name,
            views.1.len(),
            first.message
        )),
        _ => Ok(Some(placed)),
    }
}

/// Formats tracked poses and their uncertainty as one line, with the deviation from recorded poses if
/// known.
pub fn summary(trajectory: &Trajectory, error: Option<&TrajectoryError>) -> String {
    let [turn, shift] = trajectory.deviations();
    // Without recorded poses there is nothing to compare with.
    let error = error.map_or_else(String::new, |error| {
        format!(
            "; {:.2} cm and {:.2} degrees RMS from the recorded poses after rigid alignment, at most {:.2} cm ({} frames)",
            100.0 * error.rmse,
            error.turn_rmse_deg,
            100.0 * error.max,
            error.frames
        )
    });
    format!(
        "tracked: {} frames placed, {} skipped; deviations up to {:.2} degrees and {:.2} cm{error}",
        trajectory.n_placed(),
        trajectory.skipped().len(),
        turn.to_degrees(),
        100.0 * shift
    )
}

pub fn pose_summary(check: &PoseCheck) -> String {
    format!(
        "{:.0} % of depth agrees with {} neighbouring frames, median error {:.4} ({} poses)",
        100.0 * check.opened.agreement,
        check.pairs,
        check.opened.error,
        check.opened.poses.name()
    )
}
