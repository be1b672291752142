//! Arguments of `bench`.

use super::depth::DepthArgs;
use super::parse::{choice, parse_count, parse_size};
use clap::{Args, Subcommand};
use std::ffi::OsString;
use std::path::PathBuf;
use vbgs_studio::bench::findings::BenchOptions;
use vbgs_studio::bench::peers::PeerCommand;
use vbgs_studio::bench::render::BenchDevice;
use vbgs_studio::dataset::splits::HoldOut;

#[derive(Args)]
pub struct BenchArgs {
    #[command(subcommand)]
    pub bench: BenchName,
}

#[derive(Subcommand)]
pub enum BenchName {
    /// What each step from the dense E-step to forwarded reassignment costs and brings
    Ablation(DatasetBenchArgs),
    /// What every part of the scene preset brings, and components against quality
    Accuracy(DatasetBenchArgs),
    /// The paper's protocol on every scene of a folder: both presets, both renderers
    Paper(FolderBenchArgs),
    /// Speed against error: one setting at a time
    Pareto(DatasetBenchArgs),
    /// Other programs beside this one on the same frames, in turns: the published implementation,
    /// Open3D, or any that speaks as its help says
    Peers(PeersBenchArgs),
    /// Every recording of a folder learnt by default: plain figures, corrected and aligned poses, sharpness
    Real(RealBenchArgs),
    /// What a scene keeps of its frames: each one's own view right after it and at the end
    Retention(DatasetBenchArgs),
    /// Cost against points, components and threads, on the synthetic room
    Scaling(CommonArgs),
    /// Hard cases against exact arithmetic
    Stability(CommonArgs),
    /// Time per frame by stage against splats and resolution, by both renderers
    Render(RenderBenchArgs),
}

#[derive(Args)]
pub struct RenderBenchArgs {
    /// Model to draw, thinned or repeated to every number of splats [default: a synthetic scene]
    pub model: Option<PathBuf>,
    /// Numbers of splats [default: 10000 to 4000000, and the model's own]
    #[arg(long, value_name = "N,…", value_delimiter = ',', value_parser = parse_splats)]
    pub splats: Option<Vec<usize>>,
    /// Widths and heights of the images, four at most [default: 400x400,800x600,1280x720]
    #[arg(long, value_name = "WxH,…", value_delimiter = ',', value_parser = parse_size)]
    pub size: Option<Vec<[u32; 2]>>,
    /// Who draws; `all` takes a GPU only if it is not software
    #[arg(long, value_parser = choice::<BenchDevice>(), default_value = "all")]
    pub device: BenchDevice,
    /// Graphics adapter by its number or a part of its name, which may be software
    #[cfg(feature = "gui")]
    #[arg(long, value_name = "NAME")]
    pub adapter: Option<String>,
    #[command(flatten)]
    pub common: CommonArgs,
}

#[derive(Args)]
pub struct FolderBenchArgs {
    /// Folder whose folders are scenes; those without depth are left out. `paper` takes 200 training
    /// frames of a scene at most by default; of a recording without a split to be measured on, `real`
    /// holds out every 8th frame, and its --repeats counts orders of the frames [default: 3]
    #[arg(long, value_name = "DIR")]
    pub data: PathBuf,
    /// Training frames of a scene at most
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub max_frames: Option<usize>,
    #[command(flatten)]
    pub common: CommonArgs,
}

#[derive(Args)]
pub struct RealBenchArgs {
    #[command(flatten)]
    pub on: FolderBenchArgs,
    /// Frames held out of training: every eighth where a recording has no split for evaluation, or a
    /// sector of the camera's way, which adds a row of views from the side
    #[arg(long, value_name = "RULE", value_parser = choice::<HoldOut>(), default_value = "every-8th")]
    pub hold_out: HoldOut,
}

/// As many splats as a model may have components.
const MAX_SPLATS: usize = 20_000_000;

fn parse_splats(text: &str) -> Result<usize, String> {
    let count = text.parse().ok().filter(|n| (1..=MAX_SPLATS).contains(n));
    count.ok_or_else(|| format!("expected whole numbers, 1 to {MAX_SPLATS}, such as 10000,100000"))
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
pub struct PeersBenchArgs {
    #[command(flatten)]
    pub on: DatasetBenchArgs,
    /// Compare with Open3D's fusion on the processor; --python must have `open3d`
    #[arg(long)]
    pub open3d: bool,
    /// Compare with the published implementation in this checkout of its repository; --python must have
    /// what that needs
    #[arg(long, value_name = "DIR")]
    pub published: Option<PathBuf>,
    /// Compare with a program of one's own: it gets the folder of frames (`frames.json` and NumPy arrays)
    /// as its last argument, prints "ready" in quotes, then for every number of a frame on its input
    /// {"ms": 12.5}
    #[arg(long, value_name = "NAME=COMMAND", value_parser = parse_peer)]
    pub peer: Vec<PeerCommand>,
    /// Python that runs the first two
    #[arg(long, value_name = "PROGRAM", default_value = "python3")]
    pub python: PathBuf,
    /// Components of every mixture
    #[arg(long, value_name = "N", value_parser = parse_count, default_value = "10000", allow_negative_numbers = true)]
    pub components: usize,
}

impl PeersBenchArgs {
    pub fn peers(&self) -> Vec<PeerCommand> {
        let published = self.published.as_deref();
        let published = published.map(|path| PeerCommand::published(&self.python, path));
        let open3d = self.open3d.then(|| PeerCommand::open3d(&self.python));
        published.into_iter().chain(open3d).chain(self.peer.iter().cloned()).collect()
    }
}

/// A name and the words of a command.
fn parse_peer(text: &str) -> Result<PeerCommand, String> {
    let parts = text.split_once('=').and_then(|(name, command)| {
        let mut words = command.split_whitespace().map(OsString::from);
        let name = Some(name.trim()).filter(|name| !name.is_empty())?.to_owned();
        Some(PeerCommand { name, program: words.next()?, arguments: words.collect() })
    });
    parts.ok_or_else(|| "expected a name and a command, such as mine=./mine --fast".to_owned())
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
