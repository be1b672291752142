//! Arguments of `bench`.

use super::depth::ReadArgs;
use crate::cli::args::{choice, parse_count, parse_size};
use clap::{Args, Subcommand};
use std::path::PathBuf;
use vbgs_studio::bench::findings::BenchOptions;
use vbgs_studio::bench::history::Kernel;
use vbgs_studio::bench::render::BenchDevice;

#[derive(Subcommand)]
pub enum BenchName {
    /// Cost and benefit of each step from the dense E-step to forwarded reassignment
    Ablation(DatasetBenchArgs),
    /// Benefit of each part of the scene preset, and quality by number of components
    Accuracy(DatasetBenchArgs),
    /// One line of instruction counts, frame times, PSNR and size, gated by the line before
    History(HistoryArgs),
    /// The paper's protocol on all scenes of a folder, with both presets and renderers
    Paper(FolderBenchArgs),
    /// Speed against error, varying one setting at a time
    Pareto(DatasetBenchArgs),
    /// All of the page of benchmarks: every bench on this machine, as Markdown with tables and plots
    Report(ReportBenchArgs),
    /// Retention: quality of each training view right after its frame and at the end
    Retention(DatasetBenchArgs),
    /// Cost by points, components and threads, on the synthetic room
    Scaling(CommonArgs),
    /// Views on the camera's path and from the side, from points alone to photographs in full
    Views(ViewsBenchArgs),
    /// Time per frame by stage, splats and resolution, with both renderers
    Render(RenderBenchArgs),
}

#[derive(Args, Clone)]
pub struct HistoryArgs {
    /// Folder with the recordings `kinect_office` and `lego400`
    #[arg(long, value_name = "DIR", default_value = "../shared/data")]
    pub data: PathBuf,
    /// CSV to which the line is appended, unless a measure is worse than in its last line
    #[arg(long, value_name = "FILE", default_value = "history.csv")]
    pub file: PathBuf,
    /// Name of the commit in the line
    #[arg(long, value_name = "NAME", default_value = "uncommitted")]
    pub commit: String,
    /// Compiler of the program, as `rustc --version` prints it; instructions are compared only with lines of the same
    #[arg(long, value_name = "VERSION", default_value = "unknown")]
    pub compiler: String,
    /// Fail if instructions cannot be counted
    #[arg(long)]
    pub counted: bool,
    // What the counter runs.
    #[arg(long, hide = true, value_parser = choice::<Kernel>())]
    pub kernel: Option<Kernel>,
    #[arg(long, hide = true, default_value_t = 1)]
    pub times: usize,
}

#[derive(Args)]
pub struct RenderBenchArgs {
    /// Model to draw, subsampled or repeated to each number of splats [default: a synthetic scene]
    pub model: Option<PathBuf>,
    /// Numbers of splats [default: 10000 to 4000000, and the model's own]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse_splats)]
    pub splats: Option<Vec<usize>>,
    /// Image sizes, at most four [default: 400x400,800x600,1280x720]
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    pub size: Option<Vec<[u32; 2]>>,
    /// Device to draw with; `all` includes a GPU only if it is hardware
    #[arg(long, value_parser = choice::<BenchDevice>(), default_value = "all")]
    pub device: BenchDevice,
    /// Graphics adapter, by number or part of its name; may be a software adapter
    #[cfg(feature = "gui")]
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    #[command(flatten)]
    pub common: CommonArgs,
}

#[derive(Args)]
pub struct FolderBenchArgs {
    /// Folder of scenes; those without depth are skipped
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Maximum number of training frames per scene [default: 200]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
}

#[derive(Args)]
pub struct ViewsBenchArgs {
    /// Folder of recordings; those without depth are skipped [default: synthetic scenes alone]
    #[arg(long, value_name = "DIR")]
    pub data: Option<PathBuf>,
    /// Maximum number of training frames per recording, evenly spaced
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
}

#[derive(Args)]
pub struct ReportBenchArgs {
    /// Folder of recordings; those without depth are skipped
    #[arg(long, value_name = "DIR", default_value = "../shared/data")]
    pub data: PathBuf,
    /// Recording on which the published algorithm and retention are measured [default: `lego400` of the folder]
    #[arg(long, value_name = "DATASET")]
    pub dataset: Option<PathBuf>,
    /// Output folder for NAME.json, NAME.csv and NAME.png; the page lies beside it, as DIR.md
    #[arg(long, value_name = "DIR", default_value = "benchmarks")]
    pub out: PathBuf,
    /// Run reduced benchmarks, within minutes on two cores
    #[arg(long)]
    pub quick: bool,
    /// Seed of all random streams
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
}

// Equals the maximum number of components of a model.
const MAX_SPLATS: usize = 20_000_000;

fn parse_splats(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|n| (1..=MAX_SPLATS).contains(n));
    count.ok_or_else(|| format!("expected whole numbers, 1 to {MAX_SPLATS}, such as 10000,100000"))
}

#[derive(Args)]
pub struct DatasetBenchArgs {
    /// Dataset folder [default: the built-in synthetic room]
    pub dataset: Option<PathBuf>,
    /// Maximum number of training frames, evenly spaced
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
    #[command(flatten)]
    pub depth: ReadArgs,
}

#[derive(Args)]
pub struct CommonArgs {
    /// Output folder for NAME.json, NAME.csv and NAME.png
    #[arg(long, value_name = "DIR", default_value = "vbgs-bench")]
    pub out: PathBuf,
    /// Run a reduced benchmark, within a minute on two cores
    #[arg(long)]
    pub quick: bool,
    /// Number of runs per configuration
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub repeats: Option<usize>,
    /// Seed of all random streams
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
    pub depth: ReadArgs,
}
