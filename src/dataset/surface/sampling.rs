//! Selection of the depth pixels that become points.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Selection of the pixels that become points; each point is weighted by the skipped pixels it represents.
/// Plane fits over 5×5 pixels make neighbours redundant, and later frames show what a frame skips.
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
pub enum PixelSampling {
    /// Every pixel.
    #[default]
    Every,
    /// Every other row.
    Half,
    /// Every other pixel of every other row.
    Quarter,
}

impl PixelSampling {
    /// True if every usable pixel becomes a point.
    pub fn is_every(&self) -> bool {
        *self == Self::Every
    }

    /// Number of pixels represented by a point.
    pub fn weight(self) -> u32 {
        match self {
            Self::Every => 1,
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }

    /// Distance between used rows.
    pub(super) fn row_step(self) -> usize {
        if self.is_every() { 1 } else { 2 }
    }

    /// Distance between used columns.
    pub(super) fn column_step(self) -> usize {
        if self == Self::Quarter { 2 } else { 1 }
    }
}
