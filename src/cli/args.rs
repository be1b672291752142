//! Arguments of every command.

use super::bench::BenchArgs;
use super::precision_search::PrecisionSearchArgs;
use clap::builder::{PossibleValuesParser, TypedValueParser};
use clap::error::ErrorKind;
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};
use std::path::PathBuf;
use std::str::FromStr;
use vbgs_studio::dataset::LoadOptions;
use vbgs_studio::pipeline::plan::{Order, Shard};
use vbgs_studio::train::config::{
    Batch, Candidates, IndexKind, Init, Precision, Preset, ReassignPolicy, StatisticsForm,
};

/// Turns posed RGB-D frames into a Gaussian-splat scene while you watch.
///
/// Without a command, opens the window on PATH, or on a built-in demo that starts training at once.
/// Without a display the demo is trained headless into `vbgs-demo/`.
#[derive(Parser)]
#[command(version)]
pub struct Arguments {
    /// Dataset folder, checkpoint, `.ply` or `.glb` to open in the window
    pub path: Option<PathBuf>,
    /// Threads that train and render [default: one per core]
    #[arg(long, global = true, value_name = "N", value_parser = parse_count)]
    pub threads: Option<usize>,
    /// Graphics adapter of the window: part of its name, its number, `auto` or `software` [default:
    /// the one chosen in Settings, else auto]
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    #[command(subcommand)]
    pub command: Option<Command>,
}

impl Arguments {
    /// The arguments of this process; ends it with a message where they make no sense.
    pub fn from_command_line() -> Self {
        let arguments = Self::parse();
        if let (Some(path), Some(_)) = (&arguments.path, &arguments.command) {
            let message = format!("`{}` stands before a command; put it after", path.display());
            Self::command().error(ErrorKind::ArgumentConflict, message).exit();
        }
        arguments
    }
}

#[derive(Subcommand)]
pub enum Command {
    /// Train headless; writes scene.ply, checkpoint.vbgs and report.json
    Train(TrainArgs),
    /// Measure a model against the photographs of a dataset
    Eval(EvalArgs),
    /// Render one view or a turntable
    Render(RenderArgs),
    /// Convert a model to PLY, GLB or a point cloud
    Export(ExportArgs),
    /// Write a synthetic posed RGB-D dataset with ground truth
    Synth(SynthArgs),
    /// Add the statistics of models trained on different frames from the same start
    Merge(MergeArgs),
    /// Say what a dataset or a model holds, and every defect found
    Info(InfoArgs),
    /// Measure speed against error; writes a table, JSON, CSV and a plot
    Bench(BenchArgs),
    /// Find the cheapest precision of every operation within an error bound
    PrecisionSearch(PrecisionSearchArgs),
}

#[derive(Clone, Copy, ValueEnum)]
pub enum ConversionName {
    /// Eigen-decomposition, scale 1, unused components dropped
    Right,
    /// As the reference exporter: Cholesky rows, scale 1.41, unused components kept
    LegacyCov,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum GroundTruthName {
    /// Photograph composited over the background by its alpha
    Composited,
    /// RGB bytes with alpha dropped, as the paper does
    Rgb,
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
}

impl DepthArgs {
    pub fn load_options(&self) -> LoadOptions {
        let depth_range = self.depth_range.as_deref().and_then(|r| <[f64; 2]>::try_from(r).ok());
        LoadOptions { depth_scale: self.depth_scale, depth_range }
    }
}

/// What renders are compared with.
#[derive(Args)]
pub struct ComparisonArgs {
    /// What a render is compared with
    #[arg(long, value_enum, default_value = "composited")]
    pub ground_truth: GroundTruthName,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
}

#[derive(Args)]
pub struct TrainArgs {
    /// Dataset folder
    pub dataset: PathBuf,
    /// Folder for scene.ply, checkpoint.vbgs and report.json
    #[arg(long, value_name = "DIR")]
    pub out: PathBuf,
    /// Split to train on [default: the one with depth]
    #[arg(long)]
    pub split: Option<String>,
    /// Measure quality on this split afterwards
    #[arg(long, value_name = "SPLIT")]
    pub eval: Option<String>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    /// Go on with the run that wrote this checkpoint; its settings hold
    #[arg(long, value_name = "CHECKPOINT")]
    pub resume: Option<PathBuf>,
    /// Go on even if the dataset is not the one the checkpoint was trained on
    #[arg(long, requires = "resume")]
    pub force: bool,
    /// Save the checkpoint every N frames too, keeping the one before as checkpoint.vbgs.bak
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub autosave_frames: Option<usize>,
    /// Set of defaults [default: paper]
    #[arg(long, value_parser = choice::<Preset>())]
    pub preset: Option<Preset>,
    /// Seed of every random stream [default: 0]
    #[arg(long)]
    pub seed: Option<u64>,
    /// Frames at most; with --resume those already trained count
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Every N-th frame [default: 1]
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: Option<usize>,
    /// Order of the frames [default: sequential]
    #[arg(long, value_parser = choice::<Order>())]
    pub order: Option<Order>,
    /// Every N-th of these frames from the K-th on, for a model to be merged with the other shards'
    #[arg(long, value_name = "K/N")]
    pub shard: Option<Shard>,
    /// Print the report as JSON on stdout
    #[arg(long)]
    pub json: bool,
    /// Settings from a RON file; options on the command line win
    #[arg(long, value_name = "FILE.ron")]
    pub config: Option<PathBuf>,
    /// Number of components [default: 100000]
    #[arg(long, value_name = "N", allow_negative_numbers = true)]
    pub components: Option<usize>,
    /// Candidate components per point, or `dense` [default: 4]
    #[arg(long, value_name = "C", allow_negative_numbers = true)]
    pub candidates: Option<Candidates>,
    /// Points that pass through the engine at once, or `frame` [default: frame]
    #[arg(long, value_name = "POINTS", allow_negative_numbers = true)]
    pub batch: Option<Batch>,
    /// Whether responsibilities are summed at once or written out first [default: fused]
    #[arg(long, value_parser = choice::<StatisticsForm>())]
    pub statistics: Option<StatisticsForm>,
    /// How candidates are found [default: grid]
    #[arg(long, value_parser = choice::<IndexKind>())]
    pub index: Option<IndexKind>,
    /// Where initial means come from [default: random]
    #[arg(long, value_parser = choice::<Init>())]
    pub init: Option<Init>,
    /// When unused components move onto badly explained points: forwarded after the fit, the others
    /// before it [default: padded]
    #[arg(long, value_parser = choice::<ReassignPolicy>())]
    pub reassign: Option<ReassignPolicy>,
    /// Share of the unused components that may move per frame [default: 0.05]
    #[arg(long, value_name = "F", allow_negative_numbers = true)]
    pub reassign_fraction: Option<f64>,
    /// Arithmetic of the hot loops [default: mixed]
    #[arg(long, value_parser = choice::<Precision>())]
    pub precision: Option<Precision>,
    /// How covariances become splats [default: right]
    #[arg(long, value_enum)]
    pub conversion: Option<ConversionName>,
    /// Factor on the splats' standard deviations [default: that of the conversion]
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub scale_factor: Option<f64>,
    #[command(flatten)]
    pub depth: DepthArgs,
}

#[derive(Args)]
pub struct EvalArgs {
    /// Model: checkpoint, .ply or .glb
    pub model: PathBuf,
    /// Dataset folder
    pub dataset: PathBuf,
    /// Split to measure on [default: val or eval, or every 8th frame]
    #[arg(long)]
    pub split: Option<String>,
    #[command(flatten)]
    pub comparison: ComparisonArgs,
    /// Views at most
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    /// Every N-th view
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = parse_count, allow_negative_numbers = true)]
    pub stride: usize,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}

#[derive(Args)]
pub struct RenderArgs {
    /// Model: checkpoint, .ply or .glb
    pub model: PathBuf,
    /// PNG file to write; a folder with --turntable
    #[arg(short, long, value_name = "IMG.png")]
    pub output: PathBuf,
    /// Take the camera from this dataset
    #[arg(long, value_name = "DIR", conflicts_with_all = ["orbit", "turntable", "size", "fov", "up"])]
    pub dataset: Option<PathBuf>,
    /// Position of the view in its split
    #[arg(long, requires = "dataset", default_value_t = 0)]
    pub view: usize,
    /// Split of the view [default: val or eval, or the training split]
    #[arg(long, requires = "dataset")]
    pub split: Option<String>,
    /// Azimuth and elevation in degrees, distance in world units, about the scene's centre
    #[arg(long, value_name = "AZ,EL,DIST", value_parser = parse_orbit, allow_hyphen_values = true)]
    pub orbit: Option<[f64; 3]>,
    /// N views once around the scene, written as 000.png, 001.png, …
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub turntable: Option<usize>,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "1280x720", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Horizontal field of view in degrees
    #[arg(long, value_name = "DEG", default_value_t = 60.0, allow_negative_numbers = true)]
    pub fov: f64,
    /// World axis that points up [default: what the model says, else z]
    #[arg(long, value_enum, allow_hyphen_values = true)]
    pub up: Option<AxisName>,
    /// Colour behind the splats: black, white or #rrggbb
    #[arg(long, default_value = "black", value_parser = parse_color)]
    pub background: [f32; 3],
}

#[derive(Clone, Copy, ValueEnum)]
pub enum AxisName {
    X,
    Y,
    Z,
    #[value(name = "-x")]
    NegX,
    #[value(name = "-y")]
    NegY,
    #[value(name = "-z")]
    NegZ,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum FormatName {
    Ply,
    PointCloud,
    Glb,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum AxesName {
    /// The dataset's world
    AsIs,
    /// Turned to the y-down world of splat viewers (PLY)
    Viewer,
}

#[derive(Args)]
pub struct ExportArgs {
    /// Model: checkpoint, .ply or .glb
    pub model: PathBuf,
    /// File to write
    #[arg(short, long)]
    pub output: PathBuf,
    /// Format [default: by extension]
    #[arg(long, value_enum)]
    pub format: Option<FormatName>,
    /// Axes of a PLY
    #[arg(long, value_enum, default_value = "as-is")]
    pub axes: AxesName,
    /// Pad a splat PLY with 45 zero coefficients for readers that insist on them
    #[arg(long)]
    pub sh3_padding: bool,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum LayoutName {
    Blender,
    SevenScenes,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum DepthBitsName {
    #[value(name = "8")]
    Eight,
    #[value(name = "16")]
    Sixteen,
}

#[derive(Args)]
pub struct SynthArgs {
    /// New or empty folder
    pub out: PathBuf,
    /// Layout to write
    #[arg(long, value_enum, default_value = "blender")]
    pub layout: LayoutName,
    /// Bits of the Blender layout's depth
    #[arg(long, value_enum, default_value = "16")]
    pub depth_bits: DepthBitsName,
    /// Width and height in pixels
    #[arg(long, value_name = "WxH", default_value = "320x240", value_parser = parse_size)]
    pub size: [u32; 2],
    /// Training frames
    #[arg(long, value_name = "N", default_value_t = 96)]
    pub frames: usize,
    /// Evaluation frames
    #[arg(long, value_name = "N", default_value_t = 12)]
    pub eval_frames: usize,
    /// Seed of the scene
    #[arg(long, default_value_t = 0)]
    pub seed: u64,
    /// Depth noise in units of a depth camera's
    #[arg(long, value_name = "X", default_value_t = 0.0, allow_negative_numbers = true)]
    pub depth_noise: f64,
}

#[derive(Args)]
pub struct MergeArgs {
    /// Checkpoints of two runs or more
    #[arg(required = true, num_args = 2.., value_name = "CHECKPOINT")]
    pub checkpoints: Vec<PathBuf>,
    /// Checkpoint to write
    #[arg(short, long, value_name = "CHECKPOINT")]
    pub output: PathBuf,
}

#[derive(Args)]
pub struct InfoArgs {
    /// Dataset folder, checkpoint, .ply or .glb
    pub path: PathBuf,
    /// Print JSON on stdout
    #[arg(long)]
    pub json: bool,
    #[command(flatten)]
    pub depth: DepthArgs,
}

/// Parses a setting of the library by the names it has in files.
fn choice<T>() -> impl TypedValueParser<Value = T>
where
    T: FromStr<Err = strum::ParseError> + strum::VariantNames + Clone + Send + Sync + 'static,
{
    PossibleValuesParser::new(T::VARIANTS).try_map(|name| name.parse::<T>())
}

/// A whole number, 1 or more.
pub fn parse_count(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|&n| n > 0);
    count.ok_or_else(|| "expected a whole number, 1 or more".to_owned())
}

fn parse_color(text: &str) -> Result<[f32; 3], String> {
    match text {
        "black" => return Ok([0.0; 3]),
        "white" => return Ok([1.0; 3]),
        _ => {}
    }
    let hex = text.strip_prefix('#').filter(|h| h.len() == 6 && h.is_ascii());
    let byte = |i: usize| hex.and_then(|h| u8::from_str_radix(&h[2 * i..2 * i + 2], 16).ok());
    match (byte(0), byte(1), byte(2)) {
        (Some(r), Some(g), Some(b)) => Ok([r, g, b].map(|v| v as f32 / 255.0)),
        _ => Err("expected black, white or #rrggbb".to_owned()),
    }
}

fn parse_size(text: &str) -> Result<[u32; 2], String> {
    let side = |s: &str| s.parse::<u32>().ok().filter(|n| (1..=16384).contains(n));
    let parts = text.split_once('x').and_then(|(w, h)| Some([side(w)?, side(h)?]));
    parts.ok_or_else(|| "expected WIDTHxHEIGHT, each from 1 to 16384, such as 1280x720".to_owned())
}

fn parse_orbit(text: &str) -> Result<[f64; 3], String> {
    let numbers: Option<Vec<f64>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    match numbers.as_deref() {
        Some(&[azimuth, elevation, distance])
            if azimuth.is_finite()
                && elevation.is_finite()
                && distance.is_finite()
                && distance > 0.0 =>
        {
            Ok([azimuth, elevation, distance])
        }
        _ => Err("expected AZIMUTH,ELEVATION,DISTANCE with a positive distance, such as 30,20,4"
            .to_owned()),
    }
}
