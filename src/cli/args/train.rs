//! Arguments of `train`.

use super::depth::ReadArgs;
use super::settings::SettingsArgs;
use crate::cli::args::{choice, parse_count};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::pipeline::plan::Shard;
use vbgs_studio::train::setting::Preset;

/// Device for a part of the training.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceName {
    /// The faster device, as measured; never a software adapter
    Auto,
    /// The CPU; results are reproducible to the bit
    Cpu,
    /// The most capable GPU, or a software adapter if there is none
    Gpu,
}

#[derive(Args)]
pub struct TrainArgs {
    /// Dataset folder, or a Record3D .r3d
    pub dataset: PathBuf,
    /// Output folder for scene.ply, checkpoint.vbgs and report.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Train while frames are being recorded, until the folder contains recording.done or Ctrl-C
    #[arg(long)]
    pub follow: bool,
    /// Split to train on [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Frames to hold out: every 8th if there is no evaluation split, or a sector of the camera path, which
    /// measures quality for new and side views after training [default: every-8th]
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>())]
    pub hold_out: Option<HoldOut>,
    /// Measure quality on this split after training
    #[arg(long, value_name = "SPLIT")]
    pub eval: Option<String>,
    /// Resume the run of this checkpoint with its settings
    #[arg(long, value_name = "CHECKPOINT")]
    pub resume: Option<PathBuf>,
    /// Resume even if the dataset differs from the checkpoint's
    #[arg(long, requires = "resume")]
    pub force: bool,
    /// Set of defaults [default: scene]
    #[arg(long, value_parser = choice::<Preset>())]
    pub preset: Option<Preset>,
    /// Maximum number of frames, including those before --resume
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Train on every N-th of the selected frames, starting at the K-th, for merging with other shards
    #[arg(long, value_name = "K/N")]
    pub shard: Option<Shard>,
    /// Device for fitting points, with the same results, and for comparing photographs. If the GPU fails, the
    /// CPU is used
    #[arg(long, value_enum, default_value = "auto", value_name = "DEVICE")]
    pub device: DeviceName,
    /// Print the report as JSON on stdout
    #[arg(long)]
    pub json: bool,
    /// Settings from a RON file, or `scene` or `paper` for a preset's defaults; command-line options take
    /// precedence
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    #[command(flatten)]
    pub reading: ReadArgs,
}
