//! Arguments of the scene preset.

use super::choice;
use clap::{Args, ValueEnum};
use std::path::PathBuf;
use vbgs_studio::pipeline::settings::scene::{Budget, DEFAULT_PIXELS, StructuralScale};
use vbgs_studio::train::scene::config::{
    BirthRule, COMPONENT_BYTES, DEFAULT_MAX_COMPONENTS, VisibilityRule,
};

/// A part of the scene preset that can be left out.
#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Part {
    /// Depth of the plane fitted around each pixel
    PlaneFit,
    /// Dropping pixels that no plane explains
    FlyingPixels,
    /// Dropping surfaces seen at a slant
    Cosine,
    /// Moving points along their rays towards their component's plane
    Refine,
    /// Correcting each frame's pose to fit the scene
    Align,
    /// Fitting each frame's exposure to the scene's
    Gain,
    /// Closing cracks between splats when they are drawn
    Closing,
    /// Colour that varies over a splat
    Gradient,
    /// Colour that depends on the view direction
    Directional,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum SensorName {
    /// 8-bit depth along the ray, as NeRF-synthetic scenes have it
    Inverse8Ray,
    /// Structured light
    Kinect,
    /// Time of flight in phones and tablets
    Lidar,
    /// Computed depth without noise
    Exact,
}

#[derive(Args)]
pub struct SceneArgs {
    #[arg(long, value_name = "H", help_heading = "Scene preset", help = scale_help())]
    pub scale: Option<StructuralScale>,
    /// Where components are born [default: seeds]
    #[arg(long, value_parser = choice::<BirthRule>(), help_heading = "Scene preset")]
    pub births: Option<BirthRule>,
    #[arg(long, value_name = "N", help_heading = "Scene preset", help = budget_help())]
    pub budget: Option<Budget>,
    /// How the returns a component could have given are counted [default: projected, with lattices
    /// returned]
    #[arg(long, value_parser = choice::<VisibilityRule>(), help_heading = "Scene preset")]
    pub looks: Option<VisibilityRule>,
    /// Leave parts out
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        value_name = "PART",
        help_heading = "Scene preset"
    )]
    pub without: Vec<Part>,
    /// Ask for parts that this dataset or birth rule leaves out
    #[arg(
        long,
        value_enum,
        value_delimiter = ',',
        value_name = "PART",
        help_heading = "Scene preset"
    )]
    pub with: Vec<Part>,
    /// What the depth is from [default: by the dataset's files]
    #[arg(long, value_enum, help_heading = "Scene preset")]
    pub sensor: Option<SensorName>,
    /// Corrections of the cameras, a RON file [default: what is known of the layout]
    #[arg(long, value_name = "FILE.ron", help_heading = "Scene preset")]
    pub calibration: Option<PathBuf>,
}

fn scale_help() -> String {
    format!(
        "Largest distance of a point from its component: pixels such as {DEFAULT_PIXELS}px at the typical distance, or world units [default: {DEFAULT_PIXELS}px]"
    )
}

fn budget_help() -> String {
    format!(
        "Most components, or megabytes such as 20MB, of {COMPONENT_BYTES} bytes a component; the least useful are merged [default: {DEFAULT_MAX_COMPONENTS}]"
    )
}
