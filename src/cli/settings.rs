//! Settings of `train` from the command line and the file it names.

use super::args::TrainArgs;
use super::failure::Failure;
use anyhow::Context;
use serde::de::DeserializeOwned;
use std::path::Path;
use vbgs_studio::pipeline::checkpoint::ResumeRequest;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::settings::method::MethodRequest as Method;
use vbgs_studio::pipeline::settings::preset_file;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides, Preset};
use vbgs_studio::train::setting::table::SettingLayer;

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
pub fn asked(args: &TrainArgs, preset: Preset) -> Result<ResumeRequest, Failure> {
    let (mut paper, mut scene): (PaperOverrides, SceneOverrides) =
        (args.settings.layer()?, args.settings.layer()?);
    if let Some(path) = &args.config {
        match preset {
            Preset::Paper => paper = paper.or(read_config(path, PAPER_EXAMPLE)?),
            Preset::Scene => scene = scene.or(read_config(path, SCENE_EXAMPLE)?),
        }
    }
    Ok(ResumeRequest {
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
    match preset {
        Preset::Paper => {
            refuse_foreign::<SceneOverrides, PaperOverrides>(args, Preset::Scene, preset)?
        }
        Preset::Scene => {
            refuse_foreign::<PaperOverrides, SceneOverrides>(args, Preset::Paper, preset)?
        }
    }
    let ResumeRequest { paper, scene, .. } = asked(args, preset)?;
    Ok(match preset {
        Preset::Paper => Method::Paper(PaperConfig::paper().with(&paper)?),
        Preset::Scene => Method::Scene(scene),
    })
}

const PAPER_EXAMPLE: &str = "(components: 50000, candidates: 4)";
const SCENE_EXAMPLE: &str = "(scale: \"2.5px\", births: seeds)";

/// Refuses the first option that has no meaning in the preset `Own`.
fn refuse_foreign<Other: SettingLayer, Own: SettingLayer>(
    args: &TrainArgs,
    other: Preset,
    own: Preset,
) -> Result<(), Failure> {
    match args.settings.layer::<Other>()?.foreign_to::<Own>() {
        None => Ok(()),
        Some((about, _)) => Err(Failure::Usage(format!(
            "{}: expected --preset {other} beside it, found the preset {own}",
            about.name()
        ))),
    }
}

/// Settings from a file, or those of a preset by its name where no file has it.
fn read_config<T: DeserializeOwned>(path: &Path, example: &str) -> Result<T, Failure> {
    let by_name = path.to_str().filter(|_| !path.exists()).and_then(|name| name.parse().ok());
    let text = match by_name {
        Some(preset) => preset_file(preset).to_owned(),
        None => std::fs::read_to_string(path).with_context(|| {
            format!(
                "{}: expected a RON file with settings, which could not be read",
                path.display()
            )
        })?,
    };
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options
        .from_str(&text)
        .with_context(|| format!("{}: expected settings such as {example}", path.display()))?)
}
