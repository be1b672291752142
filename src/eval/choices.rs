//! Options of a comparison that reports state.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Reference of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GroundTruth {
    /// Photograph composited with straight alpha over the render's background: the fair comparison.
    Composited,
    /// RGB bytes with alpha dropped, as in the paper.
    Rgb,
}

/// Treatment of pixels that splats cover partially.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PartialCoverage {
    /// The background shows through, as renderers draw it.
    Composited,
    /// The splats' colour divided by its coverage, where that is at least
    /// [`COVERED`](super::comparison::COVERED): the result of filling all cracks (`eval.md`, Partial
    /// coverage).
    Divided,
}

/// Camera poses of evaluated views.
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
    /// As recorded.
    #[default]
    Recorded,
    /// Corrected like the surrounding training frames; as recorded if no pose was corrected.
    Corrected,
}
