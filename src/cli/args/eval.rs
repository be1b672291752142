//! Arguments of `eval`.

use super::depth::DepthArgs;
use super::render::RendererArgs;
use crate::cli::args::{choice, parse_color, parse_count, parse_positive};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::eval::choices::{PartialCoverage, ViewPoses};
use vbgs_studio::eval::scale::EvalScale;
use vbgs_studio::render::Exposing;

#[derive(Clone, Copy, ValueEnum)]
pub enum GroundTruthName {
    /// Photograph composited over the background using its alpha
    Composited,
    /// RGB without alpha, as in the paper
    Rgb,
}

/// Options for comparing renderings with photographs.
#[derive(Args)]
pub struct ComparisonArgs {
    /// Reference image
    #[arg(long, value_enum, default_value = "composited")]
    pub ground_truth: GroundTruthName,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
    /// Rendering of partly covered pixels: composited over the background, or colour divided by coverage
    /// (from 0.5 on)
    #[arg(long, value_parser = choice::<PartialCoverage>(), default_value = "composited")]
    pub partial_coverage: PartialCoverage,
    /// Brightness of scenes with auto-exposure: that of the first frames, or that recorded around each view
    #[arg(long, value_parser = choice::<Exposing>(), default_value = "recorded")]
    pub exposure: Exposing,
    /// Near plane in units of the model's world; nearer splats are not drawn [default: depends on the scene,
    /// .2 for rooms and objects in metres; .2 for models of the `paper` preset]
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive)]
    pub near: Option<f64>,
    /// Poses of the views: with the corrections of the training frames around them, or as recorded
    #[arg(long, value_parser = choice::<ViewPoses>(), default_value = "corrected")]
    pub eval_poses: ViewPoses,
    /// Also score each view after aligning its pose to its photograph, with sharpness by octave and SSIM of
    /// gradients
    #[arg(long)]
    pub align_poses: bool,
    /// Scale of the comparison, above 0 and at most 1; photographs are averaged over the area of each pixel
    #[arg(long, value_name = "F", default_value = "1", allow_negative_numbers = true)]
    pub eval_scale: EvalScale,
}

#[derive(Args)]
pub struct EvalArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz or .splat
    pub model: PathBuf,
    /// Dataset folder, or a Record3D .r3d
    pub dataset: PathBuf,
    /// Split to evaluate [default: val or eval, or every 8th frame]
    #[arg(long)]
    pub split: Option<String>,
    /// Views to evaluate, as for `train --hold-out` [default: as in the checkpoint's run, else every-8th]
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>(), conflicts_with = "split")]
    pub hold_out: Option<HoldOut>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Calibration file (RON); photographs are rendered with its colour camera [default: that of the training
    /// run, else that of the layout]
    #[arg(long, value_name = "FILE.ron")]
    pub calibration: Option<PathBuf>,
    /// Maximum number of views
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Use every N-th view
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: usize,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}
