//! Arguments of `train`.

use super::{ComparisonArgs, DepthArgs, MappingArgs, RendererArgs, SceneArgs, choice, parse_count};
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::pipeline::plan::{Order, Shard};
use vbgs_studio::train::paper::config::{
    Batch, Candidates, IndexKind, Init, Precision, Preset, ReassignPolicy, StatisticsForm,
};

#[derive(Clone, Copy, ValueEnum)]
pub enum ConversionName {
    /// Eigen-decomposition, scale 1, unused components dropped
    Right,
    /// As the reference exporter: Cholesky rows, scale 1.41, unused components kept
    LegacyCov,
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
    #[command(flatten)]
    pub renderer: RendererArgs,
    /// Go on with the run that wrote this checkpoint; its settings hold
    #[arg(long, value_name = "CHECKPOINT")]
    pub resume: Option<PathBuf>,
    /// Go on even if the dataset is not the one the checkpoint was trained on
    #[arg(long, requires = "resume")]
    pub force: bool,
    /// Save the checkpoint every N frames too, keeping the one before as checkpoint.vbgs.bak
    #[arg(long, value_name = "N", value_parser = parse_count, allow_negative_numbers = true)]
    pub autosave_frames: Option<usize>,
    /// Set of defaults [default: scene]
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
    #[arg(long, value_name = "N", allow_negative_numbers = true, help_heading = "Paper preset")]
    pub components: Option<usize>,
    /// Candidate components per point, or `dense` [default: 4]
    #[arg(long, value_name = "C", allow_negative_numbers = true, help_heading = "Paper preset")]
    pub candidates: Option<Candidates>,
    /// Points that pass through the engine at once, or `frame` [default: frame]
    #[arg(
        long,
        value_name = "POINTS",
        allow_negative_numbers = true,
        help_heading = "Paper preset"
    )]
    pub batch: Option<Batch>,
    /// Whether responsibilities are summed at once or written out first [default: fused]
    #[arg(long, value_parser = choice::<StatisticsForm>(), help_heading = "Paper preset")]
    pub statistics: Option<StatisticsForm>,
    /// How candidates are found [default: grid]
    #[arg(long, value_parser = choice::<IndexKind>(), help_heading = "Paper preset")]
    pub index: Option<IndexKind>,
    /// Where initial means come from [default: random]
    #[arg(long, value_parser = choice::<Init>(), help_heading = "Paper preset")]
    pub init: Option<Init>,
    /// When unused components move onto badly explained points: forwarded after the fit, the others
    /// before it [default: padded]
    #[arg(long, value_parser = choice::<ReassignPolicy>(), help_heading = "Paper preset")]
    pub reassign: Option<ReassignPolicy>,
    /// Share of the unused components that may move per frame [default: 0.05]
    #[arg(long, value_name = "F", allow_negative_numbers = true, help_heading = "Paper preset")]
    pub reassign_fraction: Option<f64>,
    /// Arithmetic of the hot loops [default: mixed]
    #[arg(long, value_parser = choice::<Precision>())]
    pub precision: Option<Precision>,
    /// How covariances become splats [default: right]
    #[arg(long, value_enum, help_heading = "Paper preset")]
    pub conversion: Option<ConversionName>,
    /// Factor on the splats' standard deviations [default: that of the conversion]
    #[arg(long, value_name = "X", allow_negative_numbers = true, help_heading = "Paper preset")]
    pub scale_factor: Option<f64>,
    #[command(flatten)]
    pub scene: SceneArgs,
    #[command(flatten)]
    pub mapping: MappingArgs,
    #[command(flatten)]
    pub depth: DepthArgs,
}
