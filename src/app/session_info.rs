//! What is said of a session in the scene panel.

use super::panels::legend::number;
use crate::dataset::Dataset;
use crate::dataset::surface::{Sensor, SurfaceSettings};
use crate::pipeline::session::{Session, layout_name};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::{SceneRun, StructuralScale};
use crate::train::scene::config::BirthRule;

/// Lines for the scene panel: label and value.
pub fn session_info(session: &Session) -> Vec<(String, String)> {
    let dataset: &Dataset = session.dataset();
    let path =
        dataset.path.as_ref().map_or_else(|| "built in".to_owned(), |p| p.display().to_string());
    let mut info = vec![
        ("Dataset".to_owned(), path),
        (
            "Layout".to_owned(),
            format!("{} ({})", layout_name(dataset.layout), dataset.recognised_by),
        ),
    ];
    for split in &dataset.splits {
        let k = &split.frames[0].camera.intrinsics;
        let depth = if split.has_depth { "with depth" } else { "colour only" };
        let text = format!("{} frames, {}×{}, {depth}", split.frames.len(), k.width, k.height);
        info.push((format!("Split {}", split.name), text));
    }
    match &session.config().method {
        Method::Paper(train) => {
            info.push(("Preset".to_owned(), "paper".to_owned()));
            info.push(("Components".to_owned(), train.components.to_string()));
            info.push(("Range from".to_owned(), session.config().position_range_source.clone()));
        }
        Method::Scene(run) => info.extend(scene_info(run, dataset)),
    }
    info
}

fn scene_info(run: &SceneRun, dataset: &Dataset) -> Vec<(String, String)> {
    let SceneRun { scale, engine, surface, .. } = run;
    let h = number(engine.h);
    let scale = match scale {
        StructuralScale::Pixels(n) => format!("{h} world units (asked for: {n} pixels)"),
        StructuralScale::World(_) => format!("{h} world units"),
    };
    let budget = match run.budget {
        Some(budget) => format!("{} components", budget.components()),
        None => format!("none set (at most {} components)", engine.most),
    };
    let stages = [
        (surface.plane_fit, "plane fit"),
        (surface.flying_pixels, "flying pixels dropped"),
        (surface.cosine, "slanted surfaces dropped"),
    ];
    let on: Vec<&str> = stages.iter().filter(|(is_on, _)| *is_on).map(|(_, name)| *name).collect();
    let preparation = if on.is_empty() { "depth as measured".to_owned() } else { on.join(", ") };
    [
        ("Preset", "scene".to_owned()),
        ("Structural scale", scale),
        ("Births", birth_rule(engine.births).to_owned()),
        ("Budget", budget),
        ("Sensor", sensor(surface.sensor)),
        ("Preparation", preparation),
        ("Calibration", calibration(surface, dataset).to_owned()),
    ]
    .map(|(label, value)| (label.to_owned(), value))
    .into()
}

fn birth_rule(rule: BirthRule) -> &'static str {
    match rule {
        BirthRule::Seeds => "seeds, where a point has none within the structural scale",
        BirthRule::Lattice => "cubic lattice: the order of frames does not matter",
        BirthRule::BodyCentred => "body-centred lattice: the order of frames does not matter",
    }
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

fn calibration(surface: &SurfaceSettings, dataset: &Dataset) -> &'static str {
    match &surface.calibration {
        None => "none: colour and depth are taken as registered",
        Some(_) if is_assumed(surface, dataset) => "the published Kinect's colour camera",
        Some(_) => "given",
    }
}

/// Whether the cameras are corrected by what is known of such cameras and not of these.
pub fn is_assumed(surface: &SurfaceSettings, dataset: &Dataset) -> bool {
    surface.calibration.is_some() && surface.calibration == dataset.known_calibration()
}
