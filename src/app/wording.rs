//! Texts that describe values of the library to the user.

use crate::dataset::pose_check::{PoseCheck, PoseTrial};
use crate::pipeline::plan::{Order, Plan, Selection};

pub fn pose_agreement(check: &PoseCheck) -> String {
    let PoseTrial { agreement, poses, .. } = check.opened;
    let percent = 100.0 * agreement;
    format!("{percent:.0} % of depth agrees with neighbouring frames ({})", poses.name())
}

/// Returns a warning with advice if other pose axes or another depth unit fit the recording better.
pub fn pose_warning(check: &PoseCheck) -> Option<String> {
    let PoseCheck { opened, best, .. } = check;
    if !check.has_better_reading() {
        return None;
    }
    let axes = (best.poses != opened.poses)
        .then(|| format!("its poses seem {}, not {}", best.poses.name(), opened.poses.name()));
    let unit = (best.unit != 1.0)
        .then(|| format!("the true depth appears to be {} times as long", best.unit));
    let looks: Vec<String> = axes.into_iter().chain(unit).collect();
    Some(format!(
        "{}: with this reading {:.0} % of depth agrees with neighbouring frames, as opened {:.0} %. Correct the recording, or train it from the command line with the right pose axes and depth scale, and open its checkpoint here",
        looks.join(" and "),
        100.0 * best.agreement,
        100.0 * opened.agreement
    ))
}

pub fn run_order(selection: &Selection, plan: &Plan) -> String {
    let order = match selection.order {
        Order::Sequential => "In the dataset's order",
        Order::Shuffled => "Shuffled",
    };
    let stride = match selection.stride {
        0 | 1 => "every frame".to_owned(),
        n => format!("one frame of {n}"),
    };
    let held_out = plan.held_out.as_ref().map(|_| "except those held out".to_owned());
    let shard = selection.shard.map(|shard| format!("shard {}", String::from(shard)));
    let most = selection.max_frames.map(|most| format!("at most {most}"));
    let passes = (selection.passes > 1).then(|| format!("{} passes", selection.passes));
    let parts = [Some(order.to_owned()), Some(stride), held_out, shard, most, passes];
    parts.into_iter().flatten().collect::<Vec<_>>().join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::PoseConvention;

    #[test]
    fn doubtful_poses_are_told_with_what_they_look_like() {
        let opened =
            PoseTrial { poses: PoseConvention::Opencv, unit: 1.0, agreement: 0.12, error: 0.5 };
        let best = PoseTrial { poses: PoseConvention::Opengl, agreement: 0.96, ..opened };
        let check = PoseCheck { pairs: 8, opened, is_user_set: false, best };
        let text = pose_warning(&check).unwrap();
        assert!(text.contains("opengl, not opencv") && text.contains("96 %"), "{text}");
        assert!(!text.contains("--"), "the window has no options: {text}");
        assert_eq!(pose_warning(&PoseCheck { best: opened, ..check.clone() }), None);
        assert_eq!(
            pose_agreement(&check),
            "12 % of depth agrees with neighbouring frames (opencv)"
        );
    }

    #[test]
    fn the_order_of_a_run_is_told_with_what_it_leaves_out() {
        let plan = Plan { split: 0, frames: vec![1, 2], held_out: None };
        let text = run_order(&Selection::all_frames(), &plan);
        assert_eq!(text, "In the dataset's order, every frame");
        let held_out = Some("every 8th frame".to_owned());
        let selection = Selection {
            order: Order::Shuffled,
            stride: 3,
            shard: "2/3".parse().ok(),
            max_frames: Some(40),
            passes: 2,
            ..Selection::all_frames()
        };
        assert_eq!(
            run_order(&selection, &Plan { held_out, ..plan }),
            "Shuffled, one frame of 3, except those held out, shard 2/3, at most 40, 2 passes"
        );
    }
}
