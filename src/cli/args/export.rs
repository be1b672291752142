//! Arguments of `export`.

use crate::cli::args::{
    axis, documented_choice, parse_box, parse_count, parse_positive, parse_unit_scale,
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
pub struct MappingArgs {
    /// Conversion of opacities above 0.99, for scenes with colour gradients or opacities above 1 [default: equal-area; clip with --export-split 4]
    #[arg(long, value_parser = documented_choice::<OpacityMapping>())]
    pub export_mapping: Option<OpacityMapping>,
    /// Splats written per splat of a scene with colour gradients or opacities above 1 [default: 1]
    #[arg(long, value_parser = documented_choice::<GradientSplit>())]
    pub export_split: Option<GradientSplit>,
    /// Small splats, about, that are written in place of splats with textures [default: textures are left
    /// out]
    #[arg(long, value_name = "SPLATS", value_parser = parse_count)]
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
        Mapping { opacity, detail: self.export_detail, ..best }
    }
}
