//! Settings of `train` from the command line and the file it names.

use super::args::{ConversionName, TrainArgs};
use super::failure::Failure;
use anyhow::Context;
use std::path::Path;
use vbgs_studio::model::splats::CovarianceForm;
use vbgs_studio::pipeline::checkpoint::Asked;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::train::config::{Overrides, Preset, TrainConfig};

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

/// What is said beside `--resume`.
pub fn asked(args: &TrainArgs) -> Result<Asked, Failure> {
    Ok(Asked {
        preset: args.preset,
        train: overrides(args)?,
        split: args.split.clone(),
        order: args.order,
        stride: args.stride,
        shard: args.shard,
        load: args.depth.load_options(),
        max_frames: args.max_frames,
    })
}

/// The trainer's settings.
pub fn train_config(args: &TrainArgs) -> Result<TrainConfig, Failure> {
    let preset = match args.preset {
        None | Some(Preset::Paper) => TrainConfig::paper(),
    };
    Ok(preset.with(&overrides(args)?)?)
}

/// Settings from the command line, then from the file it names.
fn overrides(args: &TrainArgs) -> Result<Overrides, Failure> {
    let file = args.config.as_deref().map(read_config).transpose()?.unwrap_or_default();
    let line = Overrides {
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
    };
    Ok(line.or(file))
}

fn read_config(path: &Path) -> Result<Overrides, Failure> {
    let text = std::fs::read_to_string(path).with_context(|| {
        format!("{}: expected a RON file with settings, which could not be read", path.display())
    })?;
    let options =
        ron::Options::default().with_default_extension(ron::extensions::Extensions::IMPLICIT_SOME);
    Ok(options.from_str(&text).with_context(|| {
        format!("{}: expected settings such as (components: 50000, candidates: 4)", path.display())
    })?)
}
