//! Conversion of native splats to plain ones, shared by all commands that write models.

use clap::{Args, ValueEnum};
use vbgs_studio::export::mapping::{GradientSplit, Mapping, OpacityMapping};

#[derive(Clone, Copy, ValueEnum)]
pub enum MappingName {
    /// Opacity 0.99, enlarged to the area of the saturated centre
    EqualArea,
    /// Opacity 0.99
    Clip,
}

#[derive(Clone, Copy, ValueEnum)]
pub enum SplitName {
    /// One splat, without the colour gradient
    #[value(name = "1")]
    One,
    /// Two along the longest axis, coloured by the gradient
    #[value(name = "2")]
    Two,
    /// Four along both surface axes, coloured by the gradient
    #[value(name = "4")]
    Four,
}

#[derive(Args)]
pub struct MappingArgs {
    /// Conversion of opacities above 0.99 in PLY, GLB and SPZ, for scenes with colour gradients or opacities
    /// above 1 [default: equal-area; clip with --export-split 4]
    #[arg(long, value_enum)]
    pub export_mapping: Option<MappingName>,
    /// Splats written to PLY, GLB and SPZ per splat of a scene with colour gradients or opacities above 1
    /// [default: 1]
    #[arg(long, value_enum)]
    pub export_split: Option<SplitName>,
}

impl MappingArgs {
    /// Returns the first of these options that was given.
    pub fn first_given_option(&self) -> Option<&'static str> {
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
            // The best choice depends on the split: equal areas for one or two, clipping for four.
            None => Mapping::for_split(split).opacity,
            Some(MappingName::EqualArea) => OpacityMapping::EqualArea,
            Some(MappingName::Clip) => OpacityMapping::Clip,
        };
        Mapping { opacity, split }
    }
}
