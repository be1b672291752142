//! How depth files are read: shared by everything that opens a dataset.

use crate::cli::failure::Failure;
use clap::{Args, ValueEnum};
use vbgs_studio::dataset::{LoadOptions, PoseConvention};

/// What a recording's pose matrices mean.
#[derive(Clone, Copy, ValueEnum)]
pub enum PoseAxesName {
    /// Camera to world; x right, y down, z forward
    Opencv,
    /// Camera to world; x right, y up, looking along -z
    Opengl,
    /// World to camera, axes as opencv
    OpencvWorldToCamera,
    /// World to camera, axes as opengl
    OpenglWorldToCamera,
    /// Camera to world; x forward, y left, z up
    Robot,
}

/// Where poses are from.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PosesName {
    /// The recording
    Recorded,
    /// Tracking: frames are placed by the scene itself, the first is the origin
    Track,
}

/// How depth files are read.
#[derive(Args)]
pub struct DepthArgs {
    /// World units per step of 16-bit depth, instead of what the dataset says
    #[arg(long, value_name = "UNITS", allow_negative_numbers = true)]
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth to trust, world units
    #[arg(long, num_args = 2, value_names = ["NEAR", "FAR"], allow_negative_numbers = true)]
    pub depth_range: Option<Vec<f64>>,
    /// What the pose matrices mean, instead of the layout's convention; `info` tells which fits
    #[arg(long, value_enum)]
    pub pose_axes: Option<PoseAxesName>,
    /// Where the frames' poses are from; tracking needs none and ignores those recorded
    #[arg(long, value_enum, default_value_t = PosesName::Recorded)]
    pub poses: PosesName,
    /// Intrinsics of the depth image in pixels, instead of the dataset's
    #[arg(long, num_args = 4, value_names = ["FX", "FY", "CX", "CY"], allow_negative_numbers = true)]
    pub intrinsics: Option<Vec<f64>>,
    /// Least confidence of depth to use, where the sensor tells it [default: 1]
    #[arg(long, value_name = "0-2", allow_negative_numbers = true)]
    pub confidence: Option<u8>,
    /// Open recordings whose video cannot be read all the same, in grey
    #[arg(long)]
    pub geometry_only: bool,
}

impl DepthArgs {
    /// [`Self::load_options`] for what cannot do without the recorded poses.
    ///
    /// # Errors
    /// Tracked ones are asked for.
    pub fn recorded_load_options(&self) -> Result<LoadOptions, Failure> {
        match self.poses {
            PosesName::Recorded => Ok(self.load_options()),
            PosesName::Track => Err(Failure::Usage(
                "--poses: expected `recorded`, since this command compares frames by their recorded poses, found `track`".to_owned(),
            )),
        }
    }

    pub fn load_options(&self) -> LoadOptions {
        let depth_range = self.depth_range.as_deref().and_then(|r| <[f64; 2]>::try_from(r).ok());
        let intrinsics = self.intrinsics.as_deref().and_then(|k| <[f64; 4]>::try_from(k).ok());
        LoadOptions {
            depth_scale: self.depth_scale,
            depth_range,
            poses: self.pose_axes.map(PoseAxesName::convention),
            intrinsics,
            confidence: self.confidence,
            geometry_only: self.geometry_only,
            track: self.poses == PosesName::Track,
            // Found in the dataset, or taken from the model beside it.
            local_origin: None,
        }
    }
}

impl PoseAxesName {
    fn convention(self) -> PoseConvention {
        match self {
            Self::Opencv => PoseConvention::Opencv,
            Self::Opengl => PoseConvention::Opengl,
            Self::OpencvWorldToCamera => PoseConvention::OpencvWorldToCamera,
            Self::OpenglWorldToCamera => PoseConvention::OpenglWorldToCamera,
            Self::Robot => PoseConvention::Robot,
        }
    }
}
