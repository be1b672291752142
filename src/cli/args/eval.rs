//! Arguments of `eval`.

use super::depth::DepthArgs;
use super::parse::{choice, parse_color, parse_count, parse_positive};
use super::renderer::RendererArgs;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::dataset::splits::HoldOut;
use vbgs_studio::eval::choices::{PartialCoverage, ViewPoses};
use vbgs_studio::eval::scale::EvalScale;
use vbgs_studio::render::Exposing;

#[derive(Clone, Copy, ValueEnum)]
pub enum GroundTruthName {
    /// Photograph composited over the background by its alpha
    Composited,
    /// RGB bytes with alpha dropped, as the paper does
    Rgb,
}

/// What renders are compared with.
#[derive(Args)]
pub struct ComparisonArgs {
    /// What a render is compared with
    #[arg(long, value_enum, default_value = "composited")]
    pub ground_truth: GroundTruthName,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
    /// What shows where splats cover a pixel in part: the background through them, or their colour
    /// divided by coverage (from 0.5 on)
    #[arg(long, value_parser = choice::<PartialCoverage>(), default_value = "composited")]
    pub partial_coverage: PartialCoverage,
    /// How bright scenes are drawn whose cameras exposed by themselves: as the first frames were, or
    /// as those recorded around each view
    #[arg(long, value_parser = choice::<Exposing>(), default_value = "recorded")]
    pub exposure: Exposing,
    /// Near plane, units of the model's world: splats that are nearer are left out [default: follows the
    /// scene, .2 for rooms and objects in metres; .2 for models of the `paper` preset]
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive)]
    pub near: Option<f64>,
    /// Where views are drawn from: moved as the frames were that the scene was learnt from around them,
    /// where their poses were corrected, or as recorded
    #[arg(long, value_parser = choice::<ViewPoses>(), default_value = "corrected")]
    pub eval_poses: ViewPoses,
    /// Score each view also from the pose that its own photograph tells, beside the plain figures: with
    /// sharpness by octave of detail and SSIM of gradients, which wrong poses would hide
    #[arg(long)]
    pub align_poses: bool,
    /// Compare at this fraction of the photographs' width and height, photographs averaged over the
    /// area of each pixel (above 0, at most 1)
    #[arg(long, value_name = "F", default_value = "1", allow_negative_numbers = true)]
    pub eval_scale: EvalScale,
}

#[derive(Args)]
pub struct EvalArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz or .splat
    pub model: PathBuf,
    /// Dataset folder, or a Record3D .r3d
    pub dataset: PathBuf,
    /// Split to measure on [default: val or eval, or every 8th frame]
    #[arg(long)]
    pub split: Option<String>,
    /// Views to measure on, as `train --hold-out` chooses them [default: as the checkpoint's run, else
    /// every-8th]
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>(), conflicts_with = "split")]
    pub hold_out: Option<HoldOut>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Corrections of the cameras, a RON file: photographs are drawn by its colour
    /// camera [default: what the model was trained with, else what is known of the layout]
    #[arg(long, value_name = "FILE.ron")]
    pub calibration: Option<PathBuf>,
    /// Views at most
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Every N-th view
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: usize,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}
