//! Choices of a comparison that reports name.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// What a render is compared with.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundTruth {
    /// Straight alpha over the render's background: the honest comparison.
    Composited,
    /// The RGB bytes with alpha dropped, as the paper does.
    Rgb,
}

/// What a render shows where splats cover a pixel in part.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PartialCoverage {
    /// The background through them, as renderers draw it.
    Composited,
    /// The splats' colour alone, divided by its coverage, where that is at least
    /// [`COVERED`](super::comparison::COVERED): what is left when cracks are filled (`eval.md`, Partial coverage).
    Divided,
}

/// Where views are drawn from.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    Display,
    EnumString,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum ViewPoses {
    /// As they were recorded.
    #[default]
    Recorded,
    /// Moved as the frames were that the scene was learnt from around them; as recorded where no pose
    /// was corrected.
    Corrected,
}
