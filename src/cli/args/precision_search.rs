//! Arguments of `precision-search`.

use super::bench::CommonArgs;
use super::depth::DepthArgs;
use super::parse::parse_count;
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub struct PrecisionSearchArgs {
    /// Dataset folder
    pub dataset: PathBuf,
    /// Maximum relative error of posterior means and covariances against f64, for 99 % of the evidence
    #[arg(long, value_name = "X", default_value_t = 1e-4, allow_negative_numbers = true)]
    pub bound: f64,
    /// Number of components [default: 100000, or 20000 with --quick]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub components: Option<usize>,
    /// Maximum number of sampled frames, evenly spaced
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}
