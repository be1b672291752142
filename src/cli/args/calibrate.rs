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
    /// Calibration file to write (RON), for `--calibration` of `train` and `eval` and for the window
    #[arg(short, long, value_name = "FILE.ron", default_value = "calibration.ron")]
    pub output: PathBuf,
    /// Initial calibration, a RON file; parameters not determined by the data keep its values [default: that
    /// of the layout]
    #[arg(long, value_name = "FILE.ron", conflicts_with = "from_scratch")]
    pub calibration: Option<PathBuf>,
    /// Start with colour registered to depth and unmodified depth, ignoring the layout's calibration
    #[arg(long)]
    pub from_scratch: bool,
    /// Also estimate each frame's exposure. `train` fits exposures itself: on the Kinect recording these
    /// gain .01 dB with colours aligned per view, and lose .06 dB without
    #[arg(long)]
    pub exposure: bool,
    /// Split to use [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Maximum number of frames, evenly spaced; --exposure uses all frames
    #[arg(long, value_name = "N", default_value_t = DEFAULT_FRAMES, value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: usize,
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}
