//! Arguments of `calibrate`.

use super::depth::DepthArgs;
use super::parse::parse_count;
use clap::Args;
use std::path::PathBuf;
use vbgs_studio::calibrate::DEFAULT_FRAMES;

#[derive(Args)]
pub struct CalibrateArgs {
    /// Dataset folder, or a Record3D .r3d
    pub dataset: PathBuf,
    /// Calibration to write, a RON file for `--calibration` of `train` and `eval` and for the window
    #[arg(short, long, value_name = "FILE.ron", default_value = "calibration.ron")]
    pub output: PathBuf,
    /// Calibration to begin with, a RON file; what the data does not determine stays as it is there
    /// [default: what is known of the layout]
    #[arg(long, value_name = "FILE.ron", conflicts_with = "from_scratch")]
    pub calibration: Option<PathBuf>,
    /// Begin with colour registered to depth and depth as decoded, whatever is known of the layout
    #[arg(long)]
    pub from_scratch: bool,
    /// Find every frame's exposure too. `train` fits exposures as frames come: on the Kinect recording
    /// these bring .01 dB with each view's colours aligned, and cost .06 dB without
    #[arg(long)]
    pub exposure: bool,
    /// Split to look at [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Frames at most, evenly spaced; --exposure looks at all frames besides
    #[arg(long, value_name = "N", default_value_t = DEFAULT_FRAMES, value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: usize,
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}
