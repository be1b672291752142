//! Settings of `train`, from the command line and its settings file.

use super::args::TrainArgs;
use super::failure::Failure;
use anyhow::anyhow;
use serde::de::DeserializeOwned;
use std::path::Path;
use vbgs_studio::dataset::read_settings;
use vbgs_studio::pipeline::checkpoint::ResumeRequest;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::settings::method::MethodRequest;
use vbgs_studio::pipeline::settings::{ForeignSetting, GivenSettings, preset_file};
use vbgs_studio::train::setting::Preset;
use vbgs_studio::train::setting::table::SettingLayer;

pub fn selection(args: &TrainArgs) -> Selection {
    let (everything, run) = (Selection::all_frames(), args.settings.run);
    Selection {
        split: args.split.clone(),
        order: run.order.unwrap_or(everything.order),
        stride: run.stride.unwrap_or(everything.stride),
        shard: args.shard,
        max_frames: args.max_frames,
        passes: run.passes.unwrap_or(everything.passes),
        follow: args.follow,
        hold_out: args.hold_out.unwrap_or(everything.hold_out),
    }
}

/// Returns all settings given for a preset, on the command line and in the file.
pub fn resume_request(args: &TrainArgs, preset: Preset) -> Result<ResumeRequest, Failure> {
    Ok(ResumeRequest {
        preset: args.preset,
        model: GivenSettings { paper: layer(args, preset)?, scene: layer(args, preset)? },
        split: args.split.clone(),
        order: args.settings.run.order,
        stride: args.settings.run.stride,
        shard: args.shard,
        load: args.reading.load_options(),
        max_frames: args.max_frames,
        passes: args.settings.run.passes,
        follow: args.follow,
        hold_out: args.hold_out,
    })
}

pub fn method_request(args: &TrainArgs) -> Result<MethodRequest, Failure> {
    let preset = args.preset.unwrap_or(Preset::Scene);
    let given = resume_request(args, preset)?.model;
    match given.foreign_to(preset) {
        None => Ok(given.request(preset)?),
        Some(ForeignSetting { setting, preset: other, .. }) => Err(Failure::Usage(format!(
            "{setting}: expected `--preset {other}` with it, found the preset {preset}"
        ))),
    }
}

pub fn calibration_file(args: &TrainArgs) -> Option<&Path> {
    let given = args.settings.given("calibration").map(Path::new);
    given.or(args.resume.as_deref()).or(args.config.as_deref())
}

/// Combines the command-line settings of one preset with those of the file, if it is for that preset.
fn layer<L: SettingLayer + DeserializeOwned>(
    args: &TrainArgs,
    meant: Preset,
) -> Result<L, Failure> {
    let said: L = args.settings.layer()?;
    match &args.config {
        Some(path) if meant == L::PRESET => Ok(said.or(read_config(path)?)),
        Some(_) | None => Ok(said),
    }
}

/// Reads settings from a file, or the defaults of a preset if there is no such file.
fn read_config<L: SettingLayer + DeserializeOwned>(path: &Path) -> Result<L, Failure> {
    let by_name = path.to_str().filter(|_| !path.exists()).and_then(|name| name.parse().ok());
    let text = match by_name {
        Some(preset) => preset_file(preset).to_owned(),
        None => read_settings(path).map_err(|found| {
            anyhow!(
                "{}: expected a RON file with settings, found: {found}; check the path and its permissions",
                path.display()
            )
        })?,
    };
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options.from_str(&text).map_err(|found| {
        anyhow!(
            "{}: expected settings such as {}, found: {found}; correct this place",
            path.display(),
            L::EXAMPLE
        )
    })?)
}
