//! Formats the check of a recording's poses.

use vbgs_studio::dataset::pose_check::PoseCheck;

/// Formats the result as one line.
pub fn summary(check: &PoseCheck) -> String {
    format!(
        "{:.0} % of depth agrees with {} neighbouring frames, median error {:.4} ({} poses)",
        100.0 * check.opened.agreement,
        check.pairs,
        check.opened.error,
        check.opened.poses.name()
    )
}

/// Recommends other options if another convention or unit fits the frames far better.
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
    if best.unit != 1.0 {
        looks.push(format!("depth seems to be {} times as long as read", rounded(best.unit)));
        advice.push(format!("a --depth-scale {} times the recording's", rounded(best.unit)));
    }
    Some(format!("{}: {against}; try {}", looks.join(" and "), advice.join(" and ")))
}

fn rounded(unit: f64) -> String {
    let text = format!("{unit:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

#[cfg(test)]
mod tests {
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
