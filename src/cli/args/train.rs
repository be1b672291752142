//! Arguments of `train`.

use super::depth::DepthArgs;
use super::eval::ComparisonArgs;
use super::mapping::MappingArgs;
use super::parse::{choice, parse_count, parse_passes, parse_seconds};
use super::renderer::RendererArgs;
use super::settings::SettingsArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use std::time::Duration;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::pipeline::plan::{Order, Shard};
use vbgs_studio::train::setting::Preset;

/// What does a part of the training.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum DeviceName {
    /// The faster one; never a software adapter
    Auto,
    /// The processor, whose results have the same bits on every run
    Cpu,
    /// The most capable GPU; a software adapter if there is no other
    Gpu,
}

#[derive(Args)]
pub struct TrainArgs {
    /// Dataset folder, or a Record3D .r3d
    pub dataset: PathBuf,
    /// Folder for scene.ply, checkpoint.vbgs and report.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Take the frames while they are recorded, until the file recording.done is in the folder, which
    /// may come later too, or until Ctrl-C
    #[arg(long)]
    pub follow: bool,
    /// Split to train on [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Frames held out of training: every eighth where the dataset has no split for evaluation, or a
    /// sector of the camera's way, which measures quality afterwards on new views and from the side
    /// [default: every-8th]
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>())]
    pub hold_out: Option<HoldOut>,
    /// Measure quality on this split afterwards
    #[arg(long, value_name = "SPLIT")]
    pub eval: Option<String>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Go on with the run that wrote this checkpoint; its settings hold
    #[arg(long, value_name = "CHECKPOINT")]
    pub resume: Option<PathBuf>,
    /// Go on even if the dataset is not the one the checkpoint was trained on
    #[arg(long, requires = "resume")]
    pub force: bool,
    /// Save the checkpoint every N frames too, beside training, keeping the one before as
    /// checkpoint.vbgs.bak
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub autosave_frames: Option<usize>,
    /// Save the checkpoint every S seconds too, beside training and likewise keeping the one before
    #[arg(long, value_name = "S", value_parser = parse_seconds, allow_negative_numbers = true)]
    pub autosave_seconds: Option<Duration>,
    /// Set of defaults [default: scene]
    #[arg(long, value_parser = choice::<Preset>())]
    pub preset: Option<Preset>,
    /// Frames at most; with --resume those already trained count
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Go through the frames N times, for those who have them all: from the second time on only
    /// their photographs teach. With --resume those before count [default: 1]
    #[arg(long, value_name = "N", value_parser = parse_passes, allow_negative_numbers = true)]
    pub passes: Option<usize>,
    /// Every N-th frame [default: 1]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: Option<usize>,
    /// Order of the frames [default: sequential]
    #[arg(long, value_parser = choice::<Order>())]
    pub order: Option<Order>,
    /// Every N-th of these frames from the K-th on, for a model to be merged with the other shards'
    #[arg(long, value_name = "K/N")]
    pub shard: Option<Shard>,
    /// What fits points: the processor, a GPU, or whichever is faster by measurement, to the same
    /// bits; a GPU that fails is given up for the processor
    #[arg(long, value_enum, default_value = "auto", value_name = "DEVICE")]
    pub device: DeviceName,
    /// What compares photographs with the scene: the processor, a GPU, or whichever is faster by
    /// measurement; a GPU that fails is given up for the processor
    #[arg(long, value_enum, default_value = "auto", value_name = "DEVICE")]
    pub photometric_device: DeviceName,
    /// Print the report as JSON on stdout
    #[arg(long)]
    pub json: bool,
    /// Settings from a RON file, or `scene` or `paper` for the preset's own; options on the command
    /// line win
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    #[command(flatten)]
    pub settings: SettingsArgs,
    #[command(flatten)]
    pub mapping: MappingArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}
