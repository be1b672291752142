//! Arguments of all commands.

#[cfg(feature = "bench")]
mod bench;
mod depth;
mod export;
mod render;
pub mod settings;
mod synth;
mod train;

#[cfg(feature = "bench")]
pub use bench::PrecisionSearchArgs;
#[cfg(feature = "bench")]
pub use bench::{
    BenchName, CommonArgs, DatasetBenchArgs, HistoryArgs, RenderBenchArgs, ReportBenchArgs,
    ViewsBenchArgs,
};
use clap::builder::{PossibleValue, PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, FromArgMatches, Parser, Subcommand};
use clap_complete::Shell;
use glam::DVec3;
use std::path::PathBuf;
use std::str::FromStr;
use std::time::Duration;
use strum::{EnumMessage, ParseError, VariantNames};
use vbgs_studio::calibrate::DEFAULT_FRAMES;
use vbgs_studio::pipeline::plan::MAX_PASSES;

pub use depth::ReadArgs;
pub use export::{ExportArgs, FormatName, KindName, RegisterArgs, parse_length, parse_point};
pub use render::{PaintName, RenderArgs};
pub use synth::SynthArgs;
pub use train::{ComparisonArgs, DeviceName, EvalArgs, Protocol, TrainArgs};

/// Turns posed RGB-D frames into a Gaussian-splat scene while you watch.
///
/// Without a command, opens PATH in the window, or a built-in demo that starts training at once.
/// Without a display, trains the demo headless into `vbgs-demo/`.
#[derive(Parser)]
#[command(version)]
pub struct Arguments {
    /// Dataset folder, checkpoint or splat file (.ply, .glb, .gltf, .spz, .sog, .splat) to open in the window
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
    pub fn from_command_line() -> Self {
        // clap's own exit would ignore a help text that cannot be written.
        let found = Self::complete_command().try_get_matches();
        let found = found.and_then(|found| Self::from_arg_matches(&found));
        let arguments = found.unwrap_or_else(|error| end(&error));
        // clap accepts a word before the command as PATH, which every command would ignore.
        if let (Some(path), Some(_)) = (&arguments.path, &arguments.command) {
            let message =
                format!("`{}` precedes the command; put it after the command", path.display());
            Self::command().error(ErrorKind::ArgumentConflict, message).exit();
        }
        arguments
    }

    /// Returns the complete command line. Unlike in the derived one, help names rarely used options in a
    /// single line.
    fn complete_command() -> clap::Command {
        let reading = ReadArgs::augment_args(clap::Command::new("reading"));
        let train = |train: clap::Command| {
            train
                // Hidden options remain valid; the last line of the help names them.
                .mut_arg("confidence", hidden)
                .mut_arg("geometry_only", hidden)
                .after_help("For some phones: --confidence and --geometry-only, as in `info`.")
        };
        let eval = |eval: clap::Command| {
            let ids = reading.get_arguments().map(|arg| arg.get_id().clone());
            ids.fold(eval, |eval, id| eval.mut_arg(id, hidden)).after_help(
                "The dataset is read as in the checkpoint's run. For other models: --calibration, \
                 --depth-scale, --depth-range, --pose-axes, --poses, --intrinsics, --confidence and \
                 --geometry-only, as in `train` and `info`.",
            )
        };
        Self::command().mut_subcommand("train", train).mut_subcommand("eval", eval)
    }
}

fn hidden(arg: clap::Arg) -> clap::Arg {
    arg.hide(true)
}

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
    /// Convert a model to PLY, GLB, SPZ, SOG, USD, a web page, a point cloud or a mesh
    Export(ExportArgs),
    /// Write a synthetic posed RGB-D dataset with ground truth
    Synth(SynthArgs),
    /// Set scale, level and place of a model in coordinates of your own, which exports apply
    Register(RegisterArgs),
    /// Merge models trained on different frames from the same start
    Merge(MergeArgs),
    /// Describe a dataset or model and list all defects found
    Info(InfoArgs),
    /// Estimate colour camera and depth bias from the data; writes a RON file
    Calibrate(CalibrateArgs),
    /// Write manual pages and completions of shells to a folder, for packages
    #[command(hide = true)]
    Manual(ManualArgs),
    #[cfg(feature = "bench")]
    /// Measure speed against error; writes a table, JSON, CSV and a plot
    #[command(subcommand)]
    Bench(BenchName),
    #[cfg(feature = "bench")]
    /// Find the cheapest precision of every operation within an error bound
    PrecisionSearch(PrecisionSearchArgs),
}

#[derive(Args)]
pub struct ManualArgs {
    /// Existing folder
    pub folder: PathBuf,
}

/// Writes a manual page for every command, and completions for four shells.
pub fn write_manual(args: &ManualArgs) -> std::io::Result<()> {
    let command = Arguments::complete_command();
    let name = command.get_name().to_owned();
    clap_mangen::generate_to(command.clone(), &args.folder)?;
    for shell in [Shell::Bash, Shell::Zsh, Shell::Fish, Shell::PowerShell] {
        clap_complete::generate_to(shell, &mut command.clone(), &name, &args.folder)?;
    }
    Ok(())
}

#[derive(Args)]
pub struct MergeArgs {
    /// Checkpoints of at least two runs
    #[arg(required = true, num_args = 2.., value_name = "CHECKPOINT")]
    pub checkpoints: Vec<PathBuf>,
    /// Checkpoint from which all of them were resumed, each with its own --shard. Required for full quality
    /// of scenes
    #[arg(long, value_name = "CHECKPOINT")]
    pub start: Option<PathBuf>,
    /// Checkpoint to write
    #[arg(short, long, value_name = "CHECKPOINT")]
    pub output: PathBuf,
}

#[derive(Args)]
pub struct InfoArgs {
    /// Dataset folder, .r3d, .mcap, checkpoint or splat file
    pub path: PathBuf,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: ReadArgs,
}

#[derive(Args)]
pub struct CalibrateArgs {
    /// Dataset folder, a Record3D .r3d or a ROS 2 .mcap
    pub dataset: PathBuf,
    /// Calibration file to write (RON), for the option `--calibration` and the window
    #[arg(short, long, value_name = "FILE.ron", default_value = "calibration.ron")]
    pub output: PathBuf,
    /// Initial calibration, a RON file; parameters not determined by the data keep its values [default: that
    /// of the layout]
    #[arg(long, value_name = "FILE.ron", conflicts_with = "from_scratch")]
    pub calibration: Option<PathBuf>,
    /// Start with colour registered to depth and unmodified depth, ignoring the layout's calibration
    #[arg(long)]
    pub from_scratch: bool,
    /// Split to use [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Maximum number of frames, evenly spaced
    #[arg(long, value_name = "N", default_value_t = DEFAULT_FRAMES, value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: usize,
    /// Print the result as JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: ReadArgs,
}

/// Returns a parser for an enum of the library by its names in files.
pub fn choice<T>() -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err = ParseError> + VariantNames + Clone + Send + Sync + 'static,
{
    // The names are listed first, so that help and errors show them.
    PossibleValuesParser::new(T::VARIANTS).try_map(|name| name.parse::<T>())
}

/// Returns a parser like that of [`choice`], with the documentation of each value in the help.
pub fn documented_choice<T>() -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err = ParseError> + VariantNames + EnumMessage + Clone + Send + Sync + 'static,
{
    let values = T::VARIANTS.iter().map(|name| {
        let value = name.parse::<T>().ok();
        let doc = value.and_then(|value| value.get_documentation()).unwrap_or_default();
        // Help texts do not end with a full stop, documentation does.
        PossibleValue::new(name).help(doc.trim_end_matches('.'))
    });
    PossibleValuesParser::new(values).try_map(|name| name.parse::<T>())
}

pub fn axis() -> impl TypedValueParser<Value = DVec3> {
    PossibleValuesParser::new(["x", "-x", "y", "-y", "z", "-z"]).map(|name| match name.as_str() {
        "x" => DVec3::X,
        "-x" => DVec3::NEG_X,
        "y" => DVec3::Y,
        "-y" => DVec3::NEG_Y,
        "z" => DVec3::Z,
        _ => DVec3::NEG_Z,
    })
}

pub fn parse_count(text: &str) -> Result<usize, String> {
    // Options of this type allow negative numbers: otherwise clap would report `-5` as an unknown option
    // instead of the expected value.
    let count = text.parse().ok().filter(|&n| n > 0);
    count.ok_or_else(|| "expected a whole number, 1 or more".to_owned())
}

pub fn parse_passes(text: &str) -> Result<usize, String> {
    let passes = text.parse().ok().filter(|n| (1..=MAX_PASSES).contains(n));
    passes.ok_or_else(|| format!("expected a whole number from 1 to {MAX_PASSES}"))
}

pub fn parse_positive(text: &str) -> Result<f64, String> {
    let number = text.parse().ok().filter(|n: &f64| n.is_finite() && *n > 0.0);
    number.ok_or_else(|| "expected a number above 0".to_owned())
}

pub fn parse_unit_scale(text: &str) -> Result<f64, String> {
    // Beyond this range, coordinates of usual scenes do not fit a file's single-precision floats.
    let factor = parse_positive(text).ok().filter(|factor| (1e-9..=1e9).contains(factor));
    factor.ok_or_else(|| "expected a factor from 1e-9 to 1e9".to_owned())
}

pub fn parse_seconds(text: &str) -> Result<Duration, String> {
    let time = parse_positive(text).ok().and_then(|s| Duration::try_from_secs_f64(s).ok());
    time.ok_or_else(|| "expected a number of seconds above 0".to_owned())
}

/// Parses numbers between commas. `None` if one is malformed or their count is another.
fn parse_numbers<const N: usize>(text: &str) -> Option<[f64; N]> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

pub fn parse_box(text: &str) -> Result<[DVec3; 2], String> {
    let numbers = parse_numbers(text).filter(|numbers| numbers.iter().all(|n| n.is_finite()));
    let [a, b, c, d, e, f] =
        numbers.ok_or("expected six numbers X,Y,Z,X,Y,Z: two opposite corners")?;
    Ok([DVec3::new(a, b, c), DVec3::new(d, e, f)])
}

pub fn parse_color(text: &str) -> Result<[f32; 3], String> {
    match text {
        "black" => return Ok([0.0; 3]),
        "white" => return Ok([1.0; 3]),
        _ => {}
    }
    // Digits only: numbers also parse with a sign, and a slice could split another character.
    let is_hex = |h: &&str| h.len() == 6 && h.bytes().all(|byte| byte.is_ascii_hexdigit());
    let hex = text.strip_prefix('#').filter(is_hex);
    let byte = |i: usize| hex.and_then(|h| u8::from_str_radix(&h[2 * i..2 * i + 2], 16).ok());
    match (byte(0), byte(1), byte(2)) {
        (Some(r), Some(g), Some(b)) => Ok([r, g, b].map(|v| v as f32 / 255.0)),
        _ => Err("expected black, white or #rrggbb".to_owned()),
    }
}

pub fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    parts.ok_or_else(|| "expected WIDTHxHEIGHT, each from 1 to 16384, such as 1280x720".to_owned())
}
