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
        eprintln!(
            "note: photographs are corrected for rolling shutter and timestamps using the recorded poses, as without --poses track"
        );
    }
    placed.lost.iter().for_each(|lost| eprintln!("warning: {}", lost.message));
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

/// Returns a warning that recommends other options, if another pose convention or depth unit fits the
/// frames far better.
pub fn warning(check: &PoseCheck) -> Option<String> {
    let (opened, best) = (check.opened, check.best);
    if !check.has_better_reading() {
        return None;
    }
    let percent = |agreement: f64| format!("{:.0} %", 100.0 * agreement);
    let against =
        format!("agreement {} against {}", percent(opened.agreement), percent(best.agreement));
    let (mut looks, mut advice) = (Vec::new(), Vec::new());
    if best.poses != opened.poses {
        let (best, opened) = (best.poses.name(), opened.poses.name());
        let says = if check.is_user_set { "--pose-axes" } else { "the layout" };
        looks.push(format!("the poses match {best}, but {says} specifies {opened}"));
        advice.push(format!("--pose-axes {best}"));
    }
    // Exactly 1 is the unit as read.
    if best.unit != 1.0 {
        looks.push(format!("depth seems to be {} times as long as read", rounded(best.unit)));
        advice.push(format!("a --depth-scale {} times the recording's", rounded(best.unit)));
    }
    Some(format!("{}: {against}; try {}", looks.join(" and "), advice.join(" and ")))
}

fn rounded(unit: f64) -> String {
    // Three digits of small factors, too.
    let text = format!("{unit:.7}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod pose_check_tests {
    use super::*;
    use vbgs_studio::dataset::PoseConvention;
    use vbgs_studio::dataset::pose_check::PoseTrial;

    #[test]
    fn a_better_reading_is_named_with_its_options() {
        let opened =
            PoseTrial { poses: PoseConvention::Opencv, unit: 1.0, agreement: 0.12, error: 0.5 };
        let better = PoseTrial { poses: PoseConvention::Opengl, agreement: 0.96, ..opened };
        let check = PoseCheck { pairs: 8, opened, is_user_set: false, best: better };
        let expected = "the poses match opengl, but the layout specifies opencv: agreement 12 % against 96 %; \
                        try --pose-axes opengl";
        assert_eq!(warning(&check).as_deref(), Some(expected));
        let asked = warning(&PoseCheck { is_user_set: true, ..check.clone() }).unwrap_or_default();
        assert!(
            asked.starts_with("the poses match opengl, but --pose-axes specifies opencv"),
            "{asked}"
        );
        let scaled = PoseTrial { unit: 5.0, agreement: 0.9, ..opened };
        let text = warning(&PoseCheck { best: scaled, ..check.clone() }).unwrap_or_default();
        assert!(
            text.contains("depth seems to be 5 times") && text.contains("--depth-scale 5"),
            "{text}"
        );
        assert_eq!(warning(&PoseCheck { best: opened, ..check }), None);
    }
}
