//! How depth files are read: shared by everything that opens a dataset.

use clap::Args;
use vbgs_studio::dataset::LoadOptions;

/// How depth files are read.
#[derive(Args)]
pub struct DepthArgs {
    /// World units per step of 16-bit depth, instead of what the dataset says
    #[arg(long, value_name = "UNITS", allow_negative_numbers = true)]
    pub depth_scale: Option<f64>,
    /// Nearest and farthest depth to trust, world units
    #[arg(long, num_args = 2, value_names = ["NEAR", "FAR"], allow_negative_numbers = true)]
    pub depth_range: Option<Vec<f64>>,
}

impl DepthArgs {
    pub fn load_options(&self) -> LoadOptions {
        let depth_range = self.depth_range.as_deref().and_then(|r| <[f64; 2]>::try_from(r).ok());
        LoadOptions { depth_scale: self.depth_scale, depth_range }
    }
}
