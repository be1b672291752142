//! Arguments of all commands.

#[cfg(feature = "bench")]
mod bench;
mod calibrate;
mod depth;
mod eval;
mod export;
mod mapping;
mod parse;
#[cfg(feature = "bench")]
mod precision_search;
mod render;
mod renderer;
mod settings;
mod synth;
mod train;

#[cfg(feature = "bench")]
pub use bench::{
    BenchArgs, BenchName, CommonArgs, DatasetBenchArgs, PeersBenchArgs, RenderBenchArgs,
};
pub use calibrate::CalibrateArgs;
pub use depth::DepthArgs;
pub use eval::{ComparisonArgs, EvalArgs, GroundTruthName};
pub use export::{AxesName, ExportArgs, FormatName, KindName};
#[cfg(feature = "bench")]
pub use precision_search::PrecisionSearchArgs;
pub use render::{AxisName, PaintName, RenderArgs};
pub use synth::{CameraName, DepthBitsName, LayoutName, SceneName, SynthArgs};
pub use train::{DeviceName, TrainArgs};

use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand};
use parse::parse_count;
use std::path::PathBuf;

/// Turns posed RGB-D frames into a Gaussian-splat scene while you watch.
///
/// Without a command, opens PATH in the window, or a built-in demo that starts training at once.
/// Without a display, trains the demo headless into `vbgs-demo/`.
#[derive(Parser)]
#[command(version)]
pub struct Arguments {
    /// Dataset folder, checkpoint or splat file (.ply, .glb, .gltf, .spz, .splat) to open in the window
    pub path: Option<PathBuf>,
    /// Threads for training and rendering [default: cores minus decoding threads (one per eight cores)]
    #[arg(long, global = true, value_name = "N", value_parser = parse_count)]
    pub threads: Option<usize>,
    /// Graphics adapter of the window: part of its name, its number, `auto` or `software` [default: that in
    /// Settings, else auto]
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    /// Calibration file (RON) of the dataset at PATH
    #[arg(long, value_name = "FILE.ron", requires = "path")]
    pub calibration: Option<PathBuf>,
    #[command(subcommand)]
    pub command: Option<Command>,
}

impl Arguments {
    /// Parses the command line; exits with a message if it is invalid.
    pub fn from_command_line() -> Self {
        let arguments = Self::try_parse().unwrap_or_else(|error| end(&error));
        // clap accepts a word before the command as PATH, which every command would ignore.
        if let (Some(path), Some(_)) = (&arguments.path, &arguments.command) {
            let message =
                format!("`{}` precedes the command; put it after the command", path.display());
            Self::command().error(ErrorKind::ArgumentConflict, message).exit();
        }
        arguments
    }
}

/// Prints the error, help or version and exits.
fn end(error: &clap::Error) -> ! {
    let is_lost = match error.print() {
        // A closed pipe is not an error: the reader stopped early.
        Err(e) => !error.use_stderr() && e.kind() != std::io::ErrorKind::BrokenPipe,
        Ok(()) => false,
    };
    std::process::exit(if is_lost { 1 } else { error.exit_code() })
}

#[derive(Subcommand)]
pub enum Command {
    /// Train headless; writes scene.ply, checkpoint.vbgs and report.json
    // Boxed, because its options are far larger than those of other commands.
    Train(Box<TrainArgs>),
    /// Measure a model against the photographs of a dataset
    Eval(EvalArgs),
    /// Render one view or a turntable
    Render(RenderArgs),
    /// Convert a model to PLY, GLB, SPZ, a point cloud or a mesh
    Export(ExportArgs),
    /// Write a synthetic posed RGB-D dataset with ground truth
    Synth(SynthArgs),
    /// Merge models trained on different frames from the same start
    Merge(MergeArgs),
    /// Describe a dataset or model and list all defects found
    Info(InfoArgs),
    /// Estimate colour camera, depth bias and exposures from the data; writes a RON file
    Calibrate(CalibrateArgs),
    #[cfg(feature = "bench")]
    /// Measure speed against error; writes a table, JSON, CSV and a plot
    Bench(BenchArgs),
    #[cfg(feature = "bench")]
    /// Find the cheapest precision of every operation within an error bound
    PrecisionSearch(PrecisionSearchArgs),
}

#[derive(Args)]
pub struct MergeArgs {
    /// Checkpoints of at least two runs
    #[arg(required = true, num_args = 2.., value_name = "CHECKPOINT")]
    pub checkpoints: Vec<PathBuf>,
    /// Checkpoint that all of them were resumed from, each with its own --shard. Required for full quality
    /// unless components are on a lattice
    #[arg(long, value_name = "CHECKPOINT")]
    pub start: Option<PathBuf>,
    /// Checkpoint to write
    #[arg(short, long, value_name = "CHECKPOINT")]
    pub output: PathBuf,
}

#[derive(Args)]
pub struct InfoArgs {
    /// Dataset folder, .r3d, checkpoint or splat file
    pub path: PathBuf,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}
