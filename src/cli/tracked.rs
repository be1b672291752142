//! Tracked poses in commands.

use super::failure::Failure;
use super::progress;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::eval::measure::Views;
use vbgs_studio::eval::trajectory_error::TrajectoryError;
use vbgs_studio::model::splat::appearance::SplatSet;
use vbgs_studio::pipeline::settings::method::Method;
use vbgs_studio::pipeline::tracked::{PlacedViews, Trajectory};

/// Places views of a dataset by tracking them against the scene; `None` for models of other presets.
///
/// # Errors
/// No view could be placed.
pub fn place(
    dataset: &Dataset,
    method: &Method,
    splats: &SplatSet,
    trajectory: &Trajectory,
    views: Views<'_>,
) -> Result<Option<PlacedViews>, Failure> {
    let Some(run) = method.scene() else { return Ok(None) };
    let bar = progress::bar(views.1.len(), "view");
    let tell = |done| bar.set_position(done as u64);
    let placed = PlacedViews::find(dataset, (run, splats.view()), trajectory, views, tell);
    bar.finish_and_clear();
    if placed.is_straightened {
        eprintln!(
            "note: photographs are corrected for rolling shutter and timestamps using the recorded poses, as without --poses track"
        );
    }
    placed.lost.iter().for_each(|lost| eprintln!("warning: {}", lost.message));
    match placed.lost.first() {
        Some(first) if placed.frames.is_empty() => Err(Failure::failed(anyhow::anyhow!(
            "{}: expected the scene to place at least one of {} views, found none; the first: {}",
            dataset.name,
            views.1.len(),
            first.message
        ))),
        _ => Ok(Some(placed)),
    }
}

/// Formats tracked poses and their uncertainty as one line, with the deviation from recorded poses.
pub fn summary(trajectory: &Trajectory, error: Option<&TrajectoryError>) -> String {
    let [turn, shift] = trajectory.deviations();
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
        trajectory.len(),
        trajectory.skipped().len(),
        turn.to_degrees(),
        100.0 * shift
    )
}
