//! Which pixels of a depth image become points.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// Which pixels become points. Each point then stands for the pixels that were left out beside it: fits
/// over 5×5 pixels make neighbours say nearly the same, and what a frame leaves out the next one shows.
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
    /// Whether every pixel becomes a point, as far as it can.
    pub fn is_every(&self) -> bool {
        *self == Self::Every
    }

    /// Pixels that a point stands for.
    pub fn weight(self) -> u32 {
        match self {
            Self::Every => 1,
            Self::Half => 2,
            Self::Quarter => 4,
        }
    }

    /// Rows from one that is used to the next.
    pub(super) fn row_step(self) -> usize {
        if self.is_every() { 1 } else { 2 }
    }

    /// The same of columns.
    pub(super) fn column_step(self) -> usize {
        if self == Self::Quarter { 2 } else { 1 }
    }
}
