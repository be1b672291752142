//! Arguments of `bench`.

use crate::cli::args::{DepthArgs, parse_count};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use vbgs_studio::pipeline::bench::BenchOptions;

#[derive(Args)]
pub struct BenchArgs {
    #[command(subcommand)]
    pub bench: BenchName,
}

#[derive(Subcommand)]
pub enum BenchName {
    /// What each step from the dense E-step to forwarded reassignment costs and brings
    Ablation(DatasetBenchArgs),
    /// Speed against error: one setting at a time
    Pareto(DatasetBenchArgs),
    /// Cost against points, components and threads, on the synthetic room
    Scaling(CommonArgs),
    /// Hard cases against exact arithmetic
    Stability(CommonArgs),
}

#[derive(Args)]
pub struct DatasetBenchArgs {
    /// Dataset folder [default: the built-in synthetic room]
    pub dataset: Option<PathBuf>,
    /// Training frames at most, evenly spaced
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}

#[derive(Args)]
pub struct CommonArgs {
    /// Folder for NAME.json, NAME.csv and NAME.png
    #[arg(long, value_name = "DIR", default_value = "vbgs-bench")]
    pub out: PathBuf,
    /// Less of everything: done within a minute on two cores
    #[arg(long)]
    pub quick: bool,
    /// Runs of every configuration
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub repeats: Option<usize>,
    /// Seed of every random stream
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
}

impl CommonArgs {
    pub fn options(&self, max_frames: Option<usize>) -> BenchOptions {
        let Self { quick, repeats, seed, .. } = *self;
        BenchOptions { quick, max_frames, repeats, seed }
    }
}
