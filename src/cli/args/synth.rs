//! Arguments of `synth`.

use crate::cli::args::{parse_positive, parse_size};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Clone, Copy, ValueEnum)]
pub enum LayoutName {
    /// NeRF-synthetic with depth
    Blender,
    SevenScenes,
    /// TUM RGB-D
    Tum,
    /// Record3D's export folder
    Record3d,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum DepthBitsName {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum CameraName {
    /// Ideal camera in the furnished room
    Room,
    /// Phone: lidar depth, drifting poses, exposure steps and motion blur
    Phone,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum SceneName {
    /// The furnished room with fine detail and cables
    Room,
    /// A flat door at close range
    Door,
}

#[derive(Args)]
pub struct SynthArgs {
    /// New or empty folder
    pub out: PathBuf,
    /// Layout to write [default: blender; record3d for the phone]
    #[arg(long, value_enum)]
    pub layout: Option<LayoutName>,
    /// Camera to simulate
    #[arg(long, value_enum, default_value = "room")]
    pub camera: CameraName,
    /// Scene recorded by the phone; needs `--camera phone` [default: room]
    #[arg(long, value_enum)]
    pub scene: Option<SceneName>,
    /// Bits per depth value [default: 16]; 8 only with the Blender layout
    #[arg(long, value_enum)]
    pub depth_bits: Option<DepthBitsName>,
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
