//! Arguments of `export`.

use crate::cli::args::{
    axis, documented_choice, parse_box, parse_numbers, parse_positive, parse_unit_scale,
};
use clap::{Args, ValueEnum};
use glam::DVec3;
use std::path::PathBuf;
use vbgs_studio::export::mapping::{GradientSplit, Mapping, OpacityMapping};
use vbgs_studio::export::{Axes, SpzVersion};

#[derive(Clone, Copy, ValueEnum)]
pub enum FormatName {
    /// Splats in the 3DGS layout
    Ply,
    /// Centres as a coloured point cloud, PLY
    PointCloud,
    /// Splats with KHR_gaussian_splatting, y up
    Glb,
    /// Splats as SPZ, y up; small, quantised
    Spz,
    /// Splats as SOG, y down; the smallest, quantised
    Sog,
    /// A page that shows the splats in a browser, without a network
    Html,
    /// Splats as particle field of OpenUSD 26.03, y up; text
    Usda,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum KindName {
    /// Splats, or their centres
    Splats,
    /// A triangle mesh: PLY, GLB or OBJ by extension. GLB and OBJ show textures, otherwise vertex colours
    Mesh,
}

#[derive(Args)]
pub struct ExportArgs {
    /// Model: checkpoint, .ply, .glb, .gltf, .spz, .sog or .splat
    pub model: PathBuf,
    /// File to write
    #[arg(short, long)]
    pub output: PathBuf,
    /// Content. A mesh requires a checkpoint of the `scene` preset and covers only observed surfaces
    #[arg(long = "as", value_enum, default_value = "splats")]
    pub kind: KindName,
    /// Cell size of the mesh, units of the model's world [default: half the structural scale]
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive)]
    pub cell: Option<f64>,
    /// Format of splats [default: by extension]
    #[arg(long, value_enum)]
    pub format: Option<FormatName>,
    /// Axes of PLY or OBJ; other formats prescribe theirs
    #[arg(long, value_parser = documented_choice::<Axes>(), default_value = "as-is")]
    pub axes: Axes,
    /// Up direction in the model's world [default: that of the model, else z]
    #[arg(long, value_parser = axis(), allow_hyphen_values = true)]
    pub up: Option<DVec3>,
    /// File units per unit of the model's world
    #[arg(long, value_name = "FACTOR", default_value = "1", value_parser = parse_unit_scale)]
    pub unit_scale: f64,
    /// Write only splats with centres in this box, in units and axes of the model's world
    #[arg(long, value_name = "X,Y,Z,X,Y,Z", allow_hyphen_values = true, value_parser = parse_box)]
    pub crop: Option<[DVec3; 2]>,
    /// Write only splats with at least this many points; MODEL must be a checkpoint
    #[arg(long, value_name = "POINTS", value_parser = parse_positive)]
    pub min_evidence: Option<f64>,
    /// Write only splats with at most this standard deviation of position, units of the model's world;
    /// MODEL must be a checkpoint
    #[arg(long, value_name = "LENGTH", value_parser = parse_positive)]
    pub max_uncertainty: Option<f64>,
    /// Pad the harmonics of a splat PLY to 45 coefficients, for readers that require them
    #[arg(long)]
    pub sh3_padding: bool,
    /// Version of SPZ [default: 3]
    #[arg(long, value_parser = documented_choice::<SpzVersion>())]
    pub spz_version: Option<SpzVersion>,
    #[command(flatten)]
    pub mapping: MappingArgs,
}

#[derive(Args)]
pub struct RegisterArgs {
    /// Checkpoint
    pub model: PathBuf,
    /// Checkpoint to write [default: MODEL, whose old file stays as .bak]
    #[arg(short, long, value_name = "CHECKPOINT")]
    pub output: Option<PathBuf>,
    /// Two points of the model's world and their distance in the new unit, such as 1.25m; m, cm, mm, km or no
    /// unit
    #[arg(long, num_args = 3, value_names = ["X,Y,Z", "X,Y,Z", "LENGTH"], allow_hyphen_values = true)]
    pub scale_by: Option<Vec<String>>,
    /// Three points of a level surface in the model's world, whose normal becomes z
    #[arg(long, num_args = 3, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = parse_point)]
    pub up_by: Option<Vec<DVec3>>,
    /// Control points, a text with a position in the model's world and its coordinates in each line: one is
    /// moved to, three and more are fitted
    #[arg(long, value_name = "FILE")]
    pub to: Option<PathBuf>,
    /// Name of the coordinate system, such as EPSG:25832
    #[arg(long, value_name = "NAME")]
    pub system: Option<String>,
    /// Remove the registration
    #[arg(long, conflicts_with_all = ["scale_by", "up_by", "to", "system"])]
    pub clear: bool,
}

/// Parses a length with or without a unit. True if the unit is the metre.
pub fn parse_length(text: &str) -> Option<(f64, bool)> {
    // `m` last, since the others end in it.
    let units = [("cm", 0.01), ("mm", 0.001), ("km", 1000.0), ("m", 1.0)];
    let text = text.trim();
    let stripped =
        units.iter().find_map(|(name, metres)| Some((text.strip_suffix(*name)?, *metres)));
    let (number, metres) = stripped.unwrap_or((text, 1.0));
    Some((parse_positive(number.trim()).ok()? * metres, stripped.is_some()))
}

pub fn parse_point(text: &str) -> Result<DVec3, String> {
    let point = parse_numbers(text).map(DVec3::from_array).filter(|point| point.is_finite());
    point.ok_or_else(|| "expected three numbers X,Y,Z".to_owned())
}

fn parse_detail(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected a whole number; 0 leaves textures out".to_owned())
}

#[derive(Args)]
pub struct MappingArgs {
    /// Conversion of opacities above 0.99, for scenes with colour gradients or opacities above 1 [default: equal-area; clip with --export-split 4]
    #[arg(long, value_parser = documented_choice::<OpacityMapping>())]
    pub export_mapping: Option<OpacityMapping>,
    /// Splats written per splat of a scene with colour gradients or opacities above 1 [default: 1]
    #[arg(long, value_parser = documented_choice::<GradientSplit>())]
    pub export_split: Option<GradientSplit>,
    /// Small splats, about, that are written in place of splats with textures; 0 leaves textures out
    /// [default: 150000]
    #[arg(long, value_name = "SPLATS", value_parser = parse_detail, allow_negative_numbers = true)]
    pub export_detail: Option<usize>,
}

impl MappingArgs {
    pub fn first_given_option(&self) -> Option<&'static str> {
        self.first_for_natives().or(self.export_detail.map(|_| "--export-detail"))
    }

    /// Returns the first given option that only native splats heed.
    pub fn first_for_natives(&self) -> Option<&'static str> {
        let mapping = self.export_mapping.map(|_| "--export-mapping");
        mapping.or(self.export_split.map(|_| "--export-split"))
    }

    pub fn mapping(&self) -> Mapping {
        // The best treatment of opacities depends on the split: equal areas for one or two, clipping for four.
        let best = Mapping::for_split(self.export_split.unwrap_or_default());
        let opacity = self.export_mapping.unwrap_or(best.opacity);
        let detail = self.export_detail.map_or(best.detail, |n| (n > 0).then_some(n));
        Mapping { opacity, detail, ..best }
    }
}
