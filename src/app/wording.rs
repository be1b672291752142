//! Texts that describe values of the library to the user: poses, the order of a run, and the properties of a
//! session in the summary.

use super::panels::signal_color::format_number;
use crate::dataset::Dataset;
use crate::dataset::Layout;
use crate::dataset::calibration::Calibration;
use crate::dataset::pose_check::{PoseCheck, PoseTrial};
use crate::dataset::surface::Sensor;
use crate::pipeline::any_preset::ComponentLimit;
use crate::pipeline::plan::{Order, Plan, Selection};
use crate::pipeline::session::Session;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::units::StructuralScale;
use glam::DVec3;

/// Returns the name by which users know a layout.
pub fn layout(layout: Layout) -> &'static str {
    match layout {
        Layout::Blender => "NeRF-synthetic (Blender)",
        Layout::SevenScenes => "7-Scenes",
        Layout::Tum => "TUM RGB-D",
        Layout::Open3d => "Open3D",
        Layout::Replica => "Replica",
        Layout::Scannet => "ScanNet",
        Layout::Nerfstudio => "nerfstudio",
        Layout::Record3d => "Record3D folder",
        Layout::Record3dArchive => "Record3D",
        Layout::StrayScanner => "Stray Scanner",
        Layout::Arkit => "ARKit",
        Layout::RtabMap => "RTAB-Map",
        Layout::Colmap => "COLMAP",
        Layout::Ros2Bag => "ROS 2 bag",
        Layout::Polycam => "Polycam",
        Layout::Scanner3d => "3D Scanner App",
        Layout::ArkitScenes => "ARKitScenes",
        Layout::ScannetPp => "ScanNet++",
        Layout::ColorDepth => "Colour and depth images",
        Layout::Synthetic => "Synthetic",
    }
}

/// Returns a length in world units as text.
pub fn length(length: f64) -> String {
    format!("{} world units", format_number(length))
}

/// Returns a number and the noun it counts, which takes an `s` unless the number is 1.
pub fn count(n: usize, noun: &str) -> String {
    format!("{} {noun}{}", grouped(n), if n == 1 { "" } else { "s" })
}

/// Returns a number with a comma between every three digits.
pub fn grouped(n: usize) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

pub fn pose_agreement(check: &PoseCheck) -> String {
    let PoseTrial { agreement, .. } = check.opened;
    format!("Poses fit: {:.0} % of depth agrees with neighbouring frames", 100.0 * agreement)
}

pub fn run_order(selection: &Selection, plan: &Plan) -> String {
    let order = match selection.order {
        Order::Sequential => "Trained in the dataset's order",
        Order::Shuffled => "Trained in random order",
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

/// Returns the properties of a session in the summary, as labels and texts.
pub fn session_info(session: &Session) -> Vec<(String, String)> {
    let dataset: &Dataset = session.dataset();
    let path =
        dataset.path.as_ref().map_or_else(|| "built in".to_owned(), |p| p.display().to_string());
    let mut info = vec![
        ("Dataset".to_owned(), path),
        ("Layout".to_owned(), format!("{} ({})", layout(dataset.layout), dataset.recognised_by)),
    ];
    for split in &dataset.splits {
        // Datasets have no empty splits.
        let k = &split.frames[0].camera.intrinsics;
        let depth = if split.has_depth { "with depth" } else { "colour only" };
        let text = format!("{} frames, {}×{}, {depth}", split.frames.len(), k.width, k.height);
        info.push((format!("Split {}", split.name), text));
    }
    let config = session.config();
    info.push(("Preset".to_owned(), config.method.preset().to_string()));
    match config.method.as_any().component_limit() {
        ComponentLimit::Fixed(n) => {
            info.push(("Splats".to_owned(), grouped(n)));
            info.push(("Range from".to_owned(), config.position_range_source.clone()));
        }
        ComponentLimit::Asked(n) => info.push(("Budget".to_owned(), count(n, "splat"))),
        ComponentLimit::Lowered(n) => {
            info.push((
                "Budget".to_owned(),
                format!("none set (memory holds {})", count(n, "splat")),
            ));
        }
        ComponentLimit::Default(n) => {
            info.push(("Budget".to_owned(), format!("none set (at most {})", count(n, "splat"))));
        }
    }
    info.extend(config.method.scene().into_iter().flat_map(scene_info));
    let is_assumed = config.method.assumes_calibration(dataset);
    info.extend(origin_info(dataset.local_origin()));
    let calibration = calibration(config.method.as_any().calibration(), is_assumed);
    info.push(("Calibration".to_owned(), calibration.to_owned()));
    info
}

/// Returns the label and the text for the local origin; `None` if the local origin equals the world's
/// origin.
pub fn origin_info(origin: DVec3) -> Option<(String, String)> {
    let [x, y, z] = origin.to_array();
    // All digits: users add the origin to exported positions.
    (origin != DVec3::ZERO).then(|| ("Local origin".to_owned(), format!("{x}  {y}  {z}")))
}

fn scene_info(run: &SceneRun) -> Vec<(String, String)> {
    let SceneRun { scale, engine, surface, .. } = run;
    let scale = match scale {
        StructuralScale::Pixels(n) => format!("{} (requested: {n} depth pixels)", length(engine.h)),
        StructuralScale::World(_) => length(engine.h),
    };
    let stages = [
        (surface.plane_fit, "plane fit"),
        (surface.flying_pixels, "flying pixels dropped"),
        (surface.cosine, "slanted surfaces dropped"),
    ];
    let on: Vec<&str> = stages.iter().filter(|(is_on, _)| *is_on).map(|(_, name)| *name).collect();
    let preparation = if on.is_empty() { "depth as measured".to_owned() } else { on.join(", ") };
    [("Splat size", scale), ("Sensor", sensor(surface.sensor)), ("Preparation", preparation)]
        .map(|(label, value)| (label.to_owned(), value))
        .into()
}

fn sensor(sensor: Sensor) -> String {
    match sensor {
        Sensor::Inverse8Ray => "8-bit ray distance".to_owned(),
        Sensor::Kinect => "Kinect".to_owned(),
        Sensor::Lidar => "time of flight".to_owned(),
        Sensor::Exact { noise: 0.0 } => "computed depth".to_owned(),
        Sensor::Exact { noise } => format!("computed depth with noise {noise}"),
    }
}

fn calibration(calibration: Option<&Calibration>, is_assumed: bool) -> &'static str {
    match calibration {
        None => "none: colour and depth are assumed to be registered",
        Some(_) if is_assumed => "colour camera of the published Kinect calibration",
        Some(_) => "given",
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_grouped_and_nouns_agree() {
        let texts = [0, 1, 999, 1000, 74592, 1234567].map(|n| count(n, "splat"));
        let expected = [
            "0 splats",
            "1 splat",
            "999 splats",
            "1,000 splats",
            "74,592 splats",
            "1,234,567 splats",
        ];
        assert_eq!(texts, expected);
    }

    #[test]
    fn the_order_of_a_run_is_told_with_what_it_leaves_out() {
        let plan = Plan { split: 0, frames: vec![1, 2], held_out: None };
        let text = run_order(&Selection::all_frames(), &plan);
        assert_eq!(text, "Trained in the dataset's order, every frame");
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
            "Trained in random order, one frame of 3, except those held out, shard 2/3, at most 40, 2 passes"
        );
    }
}
