//! Options for reading depth and poses, shared by all commands that open a dataset.

use super::documented_choice;
use crate::cli::failure::Failure;
use clap::{Args, ValueEnum};
use vbgs_studio::dataset::{LoadOptions, PoseConvention};

/// Source of the poses.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PosesName {
    /// Poses of the recording
    Recorded,
    /// Track the camera against the scene; the first frame is the origin
    Track,
}

#[derive(Args)]
pub struct ReadArgs {
    /// World units per step of 16-bit depth, overriding the dataset
    #[arg(long, value_name = "UNITS", allow_negative_numbers = true)]
    pub depth_scale: Option<f64>,
    /// Nearest and farthest valid depth, world units
    #[arg(long, num_args = 2, value_names = ["NEAR", "FAR"], allow_negative_numbers = true)]
    pub depth_range: Option<Vec<f64>>,
    /// Convention of pose matrices, overriding the layout; `info` shows which one fits
    #[arg(long, value_parser = documented_choice::<PoseConvention>())]
    pub pose_axes: Option<PoseConvention>,
    /// Source of the poses; tracking ignores recorded ones
    #[arg(long, value_enum, default_value_t = PosesName::Recorded)]
    pub poses: PosesName,
    /// Intrinsics of the depth image in pixels, overriding the dataset
    #[arg(long, num_args = 4, value_names = ["FX", "FY", "CX", "CY"], allow_negative_numbers = true)]
    pub intrinsics: Option<Vec<f64>>,
    /// Minimum depth confidence, for sensors that record it [default: 1]
    #[arg(long, value_name = "0-2", allow_negative_numbers = true)]
    pub confidence: Option<u8>,
    /// Open recordings whose video cannot be decoded, in grey
    #[arg(long)]
    pub geometry_only: bool,
}

impl ReadArgs {
    /// Returns the load options for commands that require recorded poses.
    ///
    /// # Errors
    /// Tracking was requested.
    pub fn recorded_load_options(&self) -> Result<LoadOptions, Failure> {
        match self.poses {
            PosesName::Recorded => Ok(self.load_options()),
            PosesName::Track => Err(usage!(
                "--poses: expected `recorded`, since this command compares frames by their recorded poses, found `track`"
            )),
        }
    }

    pub fn load_options(&self) -> LoadOptions {
        // The conversions never fail: clap checks the number of values.
        let depth_range = self.depth_range.as_deref().and_then(|r| <[f64; 2]>::try_from(r).ok());
        let intrinsics = self.intrinsics.as_deref().and_then(|k| <[f64; 4]>::try_from(k).ok());
        LoadOptions {
            depth_scale: self.depth_scale,
            depth_range,
            poses: self.pose_axes,
            intrinsics,
            confidence: self.confidence,
            geometry_only: self.geometry_only,
            track: self.poses == PosesName::Track,
            // Determined by a calibration, and by the dataset or the model used with it.
            calibrated_photographs: false,
            local_origin: None,
        }
    }
}
