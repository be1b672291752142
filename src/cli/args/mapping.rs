//! How splats of native appearance become plain ones: shared by everything that writes models.

use clap::{Args, ValueEnum};
use vbgs_studio::export::mapping::{GradientSplit, Mapping, OpacityMapping};

#[derive(Clone, Copy, ValueEnum)]
pub enum MappingName {
    /// Opacity 0.99, and wide enough for the area that the flat top covered
    EqualArea,
    /// Opacity 0.99
    Clip,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum SplitName {
    /// One splat; its colour gradient is lost
    #[value(name = "1")]
    One,
    /// Two along the longest axis, coloured by the gradient
    #[value(name = "2")]
    Two,
    /// Four along both axes of the surface, coloured by the gradient
    #[value(name = "4")]
    Four,
}

#[derive(Args)]
pub struct MappingArgs {
    /// What PLY, GLB and SPZ hold of opacities above 0.99, in a scene with colour gradients or opacities
    /// above 1 [default: equal-area; clip with --export-split 4]
    #[arg(long, value_enum)]
    pub export_mapping: Option<MappingName>,
    /// Splats of PLY, GLB and SPZ for each of a scene with colour gradients or opacities above 1
    /// [default: 1]
    #[arg(long, value_enum)]
    pub export_split: Option<SplitName>,
}

impl MappingArgs {
    /// The first option given.
    pub fn said(&self) -> Option<&'static str> {
        let mapping = self.export_mapping.map(|_| "--export-mapping");
        mapping.or(self.export_split.map(|_| "--export-split"))
    }

    pub fn mapping(&self) -> Mapping {
        let split = match self.export_split {
            None | Some(SplitName::One) => GradientSplit::One,
            Some(SplitName::Two) => GradientSplit::Two,
            Some(SplitName::Four) => GradientSplit::Four,
        };
        let opacity = match self.export_mapping {
            // What is best depends on the split: equal areas for one or two, clipping for four.
            None => Mapping::of(split).opacity,
            Some(MappingName::EqualArea) => OpacityMapping::EqualArea,
            Some(MappingName::Clip) => OpacityMapping::Clip,
        };
        Mapping { opacity, split }
    }
}
