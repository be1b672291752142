//! Arguments of `synth`.

use super::parse::{parse_positive, parse_size};
use clap::{Args, ValueEnum};
use std::path::PathBuf;

#[derive(Clone, Copy, ValueEnum)]
pub enum LayoutName {
    /// NeRF-synthetic with depth
    Blender,
    SevenScenes,
    /// TUM RGB-D
    Tum,
    /// Open3D or Redwood
    Open3d,
    /// Replica as NICE-SLAM rendered it
    Replica,
    /// ScanNet's export
    Scannet,
    Nerfstudio,
    /// Record3D's exported folder
    Record3d,
    /// Record3D's .r3d
    Record3dArchive,
    /// Stray Scanner, its video unpacked
    StrayScanner,
    /// ARKit package of JSON lines
    Arkit,
    /// RTAB-Map's export
    RtabMap,
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
    /// A flat door from nearby
    Door,
}

#[derive(Args)]
pub struct SynthArgs {
    /// New or empty folder
    pub out: PathBuf,
    /// Layout to write [default: blender; record3d for the phone]
    #[arg(long, value_enum)]
    pub layout: Option<LayoutName>,
    /// What records the scene
    #[arg(long, value_enum, default_value = "room")]
    pub camera: CameraName,
    /// What the phone records; needs `--camera phone` [default: room]
    #[arg(long, value_enum)]
    pub scene: Option<SceneName>,
    /// Bits of the depth, 16 if not said; only the Blender layout has 8
    #[arg(long, value_enum)]
    pub depth_bits: Option<DepthBitsName>,
    /// Width and height of photographs in pixels [default: 320x240; 1440x1920 for the phone]
    #[arg(long, value_name = "WxH", value_parser = parse_size)]
    pub size: Option<[u32; 2]>,
    /// Training frames
    #[arg(long, value_name = "N", default_value_t = 96)]
    pub frames: usize,
    /// Evaluation frames
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub eval_frames: usize,
    /// True pictures from anywhere in free space, as the split `free`; beside a recording without
    /// splits they are a dataset in its sub-folder `free`
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub free_frames: usize,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Depth noise in units of a depth camera's
    #[arg(long, value_name = "X", default_value_t = 0.0, allow_negative_numbers = true)]
    pub depth_noise: f64,
    /// Write it as it is recorded, so many frames a second, for `train --follow`
    #[arg(long, value_name = "FPS", value_parser = parse_positive, allow_negative_numbers = true)]
    pub live: Option<f64>,
}
