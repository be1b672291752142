//! Arguments of `train`.

use super::depth::DepthArgs;
use super::eval::ComparisonArgs;
use super::export::MappingArgs;
use super::render::RendererArgs;
use super::settings::SettingsArgs;
use crate::cli::args::{choice, parse_count, parse_passes, parse_seconds};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::pipeline::plan::{Order, Shard};
use vbgs_studio::train::setting::Preset;

/// Device for a part of the training.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceName {
    /// The faster one, as measured; never a software adapter
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
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Resume the run of this checkpoint with its settings
    #[arg(long, value_name = "CHECKPOINT")]
    pub resume: Option<PathBuf>,
    /// Resume even if the dataset differs from the checkpoint's
    #[arg(long, requires = "resume")]
    pub force: bool,
    /// Also save the checkpoint every N frames in the background; the previous one becomes
    /// checkpoint.vbgs.bak
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub autosave_frames: Option<usize>,
    /// Also save the checkpoint every S seconds in the background, as --autosave-frames does
    #[arg(long, value_name = "S", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub autosave_seconds: Option<Duration>,
    /// Set of defaults [default: scene]
    #[arg(long, value_parser = choice::<Preset>())]
    pub preset: Option<Preset>,
    /// Maximum number of frames, including those before --resume
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Number of passes over the frames, including those before --resume. Later passes train only on
    /// photographs [default: 1]
    #[arg(long, value_name = "N", value_parser = parse_passes, allow_negative_numbers = true)]
    pub passes: Option<usize>,
    /// Use every N-th frame [default: 1]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: Option<usize>,
    /// Order of the frames [default: sequential]
    #[arg(long, value_parser = choice::<Order>())]
    pub order: Option<Order>,
    /// Train on every N-th of these frames, starting at the K-th, for merging with other shards
    #[arg(long, value_name = "K/N")]
    pub shard: Option<Shard>,
    /// Device for fitting points: CPU, GPU, or the faster one as measured; results are the same. If the GPU
    /// fails, the CPU is used
    #[arg(long, value_enum, default_value = "auto", value_name = "DEVICE")]
    pub device: DeviceName,
    /// Device for comparing photographs with the scene: CPU, GPU, or the faster one as measured. If the GPU
    /// fails, the CPU is used
    #[arg(long, value_enum, default_value = "auto", value_name = "DEVICE")]
    pub photometric_device: DeviceName,
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
    pub mapping: MappingArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}
