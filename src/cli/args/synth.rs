//! Arguments of `synth`.

use crate::cli::args::{choice, documented_choice, parse_positive, parse_size};
use clap::Args;
use std::path::PathBuf;
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout};
use vbgs_studio::dataset::synthetic::{PhoneScene, SyntheticCamera};

#[derive(Args)]
pub struct SynthArgs {
    /// New or empty folder
    pub out: PathBuf,
    /// Layout to write [default: blender; record3d for the phone]
    #[arg(long, value_parser = documented_choice::<SyntheticLayout>())]
    pub layout: Option<SyntheticLayout>,
    /// Camera to simulate
    #[arg(long, value_parser = documented_choice::<SyntheticCamera>(), default_value = "room")]
    pub camera: SyntheticCamera,
    /// Scene recorded by the phone; needs `--camera phone` [default: room]
    #[arg(long, value_parser = documented_choice::<PhoneScene>())]
    pub scene: Option<PhoneScene>,
    /// Bits per depth value [default: 16]; 8 only with the Blender layout
    #[arg(long, value_parser = choice::<DepthBits>())]
    pub depth_bits: Option<DepthBits>,
    /// Photograph size in pixels [default: 320x240; 1440x1920 for the phone]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Number of training frames
    #[arg(long, value_name = "N", default_value_t = 96)]
    pub frames: usize,
    /// Number of evaluation frames
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub eval_frames: usize,
    /// Number of noise-free views from arbitrary positions, in the split `free`; for layouts without
    /// splits, in the sub-folder `free`
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub free_frames: usize,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Depth noise relative to that of a depth camera
    #[arg(long, value_name = "X", default_value_t = 0.0, allow_negative_numbers = true)]
    pub depth_noise: f64,
    /// Write frames in real time, at this rate, for `train --follow`
    #[arg(long, value_name = "FPS", value_parser = parse_positive, allow_negative_numbers = true)]
    pub live: Option<f64>,
}
