//! Settings of `train` from the command line and the file it names.

use super::args::{ConversionName, Part, SensorName, TrainArgs};
use super::failure::Failure;
use anyhow::Context;
use serde::de::DeserializeOwned;
use std::path::Path;
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::surface::Sensor;
use vbgs_studio::model::splat::splats::CovarianceForm;
use vbgs_studio::pipeline::checkpoint::Asked;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::settings::method::Asked as Method;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, Precision, Preset};
use vbgs_studio::train::scene::sum_form::SumForm;
use vbgs_studio::train::setting::ConfigError;

/// Frames and their order.
pub fn selection(args: &TrainArgs) -> Selection {
    let everything = Selection::everything();
    Selection {
        split: args.split.clone(),
        order: args.order.unwrap_or(everything.order),
        stride: args.stride.unwrap_or(everything.stride),
        shard: args.shard,
        max_frames: args.max_frames,
    }
}

/// What is said of a model of some preset, on the command line and in the file that it names.
pub fn asked(args: &TrainArgs, preset: Preset) -> Result<Asked, Failure> {
    let (mut paper, mut scene) = (line(args), scene_line(args)?);
    if let Some(path) = &args.config {
        match preset {
            Preset::Paper => paper = paper.or(read_config(path, PAPER_EXAMPLE)?),
            Preset::Scene => scene = scene.or(read_config(path, SCENE_EXAMPLE)?),
        }
    }
    Ok(Asked {
        preset: args.preset,
        paper,
        scene,
        split: args.split.clone(),
        order: args.order,
        stride: args.stride,
        shard: args.shard,
        load: args.depth.load_options(),
        max_frames: args.max_frames,
    })
}

/// The model's settings.
pub fn method(args: &TrainArgs) -> Result<Method, Failure> {
    let preset = args.preset.unwrap_or(Preset::Scene);
    refuse_foreign(args, preset)?;
    let asked = asked(args, preset)?;
    Ok(match preset {
        Preset::Paper => Method::Paper(PaperConfig::paper().with(&asked.paper)?),
        Preset::Scene => Method::Scene(asked.scene),
    })
}

const PAPER_EXAMPLE: &str = "(components: 50000, candidates: 4)";
const SCENE_EXAMPLE: &str = "(scale: \"2.5px\", births: seeds)";

/// Refuses the first option that has no meaning in a preset.
fn refuse_foreign(args: &TrainArgs, preset: Preset) -> Result<(), Failure> {
    let scene = &args.scene;
    let given = match preset {
        Preset::Scene => [
            ("--components", args.components.is_some()),
            ("--candidates", args.candidates.is_some()),
            ("--batch", args.batch.is_some()),
            ("--statistics", args.statistics.is_some()),
            ("--index", args.index.is_some()),
            ("--init", args.init.is_some()),
            ("--reassign", args.reassign.is_some()),
            ("--reassign-fraction", args.reassign_fraction.is_some()),
            ("--conversion", args.conversion.is_some()),
            ("--scale-factor", args.scale_factor.is_some()),
        ]
        .to_vec(),
        Preset::Paper => [
            ("--scale", scene.scale.is_some()),
            ("--births", scene.births.is_some()),
            ("--budget", scene.budget.is_some()),
            ("--looks", scene.looks.is_some()),
            ("--without", !scene.without.is_empty()),
            ("--with", !scene.with.is_empty()),
            ("--sensor", scene.sensor.is_some()),
            ("--calibration", scene.calibration.is_some()),
        ]
        .to_vec(),
    };
    let Some((setting, _)) = given.into_iter().find(|(_, given)| *given) else { return Ok(()) };
    let (expected, found) = match preset {
        Preset::Scene => ("--preset paper beside it", "the preset scene"),
        Preset::Paper => ("--preset scene beside it", "the preset paper"),
    };
    Err(ConfigError { setting, expected: expected.into(), found: found.into() }.into())
}

/// Settings of the paper's preset from the command line.
fn line(args: &TrainArgs) -> PaperOverrides {
    PaperOverrides {
        seed: args.seed,
        components: args.components,
        candidates: args.candidates,
        batch: args.batch,
        statistics: args.statistics,
        index: args.index,
        init: args.init,
        reassign: args.reassign,
        reassign_fraction: args.reassign_fraction,
        precision: args.precision,
        operations: None,
        covariance_form: args.conversion.map(|conversion| match conversion {
            ConversionName::Right => CovarianceForm::Eigen,
            ConversionName::LegacyCov => CovarianceForm::LegacyCholesky,
        }),
        scale_factor: args.scale_factor,
    }
}

/// Settings of the scene's preset from the command line.
fn scene_line(args: &TrainArgs) -> Result<SceneOverrides, Failure> {
    let scene = &args.scene;
    let part = |part: Part| {
        let asked = scene.with.contains(&part).then_some(true);
        asked.or(scene.without.contains(&part).then_some(false))
    };
    let sums = match args.precision {
        None => None,
        Some(Precision::F64) => Some(SumForm::F64),
        Some(Precision::Mixed) => Some(SumForm::Mixed),
        Some(Precision::F32) => Some(SumForm::F32),
        Some(Precision::Custom) => None,
    };
    Ok(SceneOverrides {
        seed: args.seed,
        scale: scene.scale,
        births: scene.births,
        budget: scene.budget,
        refine: part(Part::Refine),
        align: part(Part::Align),
        gain: part(Part::Gain),
        closing: part(Part::Closing),
        looks: scene.looks,
        gradient: part(Part::Gradient),
        directional: part(Part::Directional),
        sums,
        plane_fit: part(Part::PlaneFit),
        flying_pixels: part(Part::FlyingPixels),
        cosine: part(Part::Cosine),
        sensor: scene.sensor.map(|name| match name {
            SensorName::Inverse8Ray => Sensor::Inverse8Ray,
            SensorName::Kinect => Sensor::Kinect,
            SensorName::Lidar => Sensor::Lidar,
            SensorName::Exact => Sensor::Exact { noise: 0.0 },
        }),
        calibration: scene.calibration.as_deref().map(Calibration::read).transpose()?,
    })
}

fn read_config<T: DeserializeOwned>(path: &Path, example: &str) -> Result<T, Failure> {
    let text = std::fs::read_to_string(path).with_context(|| {
        format!("{}: expected a RON file with settings, which could not be read", path.display())
    })?;
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options
        .from_str(&text)
        .with_context(|| format!("{}: expected settings such as {example}", path.display()))?)
}
