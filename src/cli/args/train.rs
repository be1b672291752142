//! Arguments of `train` and `eval`.

use super::depth::ReadArgs;
use super::render::RendererName;
use super::settings::SettingsArgs;
use crate::cli::args::{choice, parse_color, parse_count};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::eval::scale::EvalScale;
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
    /// Dataset folder, a Record3D .r3d or a ROS 2 .mcap
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

/// Rules for comparing renderings with photographs.
#[derive(Clone, Copy, Default, PartialEq, Eq, ValueEnum)]
pub enum Protocol {
    /// Photographs composited over the background by their alpha, poses and exposure corrected as in training
    #[default]
    Composited,
    /// As published: colours without alpha, recorded poses, neutral exposure; the exact renderer with
    /// antialiasing `reference`, along the whole line
    Paper,
}

/// Options for comparing renderings with photographs.
#[derive(Args, Default)]
pub struct ComparisonArgs {
    /// Rules of the comparison
    #[arg(long, value_enum, default_value_t = Protocol::Composited)]
    pub protocol: Protocol,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
    /// Also score each view after aligning its pose to its photograph, with sharpness per octave and SSIM of
    /// gradients
    #[arg(long)]
    pub align_poses: bool,
    /// Scale of the comparison, above 0 and at most 1; photographs are averaged over the area of each pixel
    #[arg(long, value_name = "F", default_value = "1", allow_negative_numbers = true)]
    pub eval_scale: EvalScale,
}

#[derive(Args)]
pub struct EvalArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz, .sog or .splat
    pub model: PathBuf,
    /// Dataset folder, a Record3D .r3d or a ROS 2 .mcap
    pub dataset: PathBuf,
    /// Split to evaluate [default: val or eval, or every 8th frame]
    #[arg(long)]
    pub split: Option<String>,
    /// Views to evaluate, as for `train --hold-out` [default: as in the checkpoint's run, else every-8th]
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>(), conflicts_with = "split")]
    pub hold_out: Option<HoldOut>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    /// Renderer
    #[arg(long, value_enum, default_value = "projected")]
    pub renderer: RendererName,
    /// Maximum number of views
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    // The help names these in one line: only models that do not state them need them.
    /// Calibration file (RON); photographs are rendered with its colour camera [default: that of the training
    /// run, else that of the layout]
    #[arg(long, value_name = "FILE.ron", hide = true)]
    pub calibration: Option<PathBuf>,
    #[command(flatten)]
    pub reading: ReadArgs,
}
