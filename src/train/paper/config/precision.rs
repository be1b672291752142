//! Arithmetic of each operation in the hot loops.

pub use crate::model::paper::totals::UpdateWidth;
use crate::train::setting::value::{SettingValue, ValueError, named_values};
use serde::{Deserialize, Serialize};
use std::ffi::OsStr;
use strum::EnumString;

/// A named choice of [`Operations`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Precision {
    /// f64 throughout, including points and means: the reference.
    F64,
    /// f32 in hot loops about a local centre, 64-bit fixed-point totals.
    Mixed,
    /// f32 throughout, including totals, which depend on the order of frames and drift.
    F32,
    /// Chosen by operation, see [`Operations`].
    #[strum(disabled)]
    Custom,
}

named_values!(by name Precision {
    "f64" "Double" "Double precision throughout, the reference";
    "mixed" "Mixed" "Single precision in the loops, exact totals";
    "f32" "Single" "Single precision throughout: totals depend on the order of frames and drift";
});

impl Precision {
    /// Returns the operations of a named precision; `None` for [`Self::Custom`].
    pub fn operations(self) -> Option<Operations> {
        match self {
            Self::F64 => Some(Operations::F64),
            Self::Mixed => Some(Operations::MIXED),
            Self::F32 => Some(Operations::F32),
            Self::Custom => None,
        }
    }
}

/// Width of one operation on f32 points and means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Width {
    /// Single precision.
    F32,
    /// Double precision.
    F64,
}

/// Arithmetic by operation.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Operations {
    /// Squared distances that rank candidates.
    pub distance: Width,
    /// Scores `q` of the candidates.
    pub log_score: Width,
    /// Exponentials and their sum.
    pub normaliser: Width,
    /// Sums over the points of a tile.
    pub moments: Width,
    /// Addition of a tile's sums to the totals.
    pub update: UpdateWidth,
}

impl Operations {
    /// All in f64 with 128-bit totals.
    pub const F64: Self = Self::all(Width::F64, UpdateWidth::Fixed128);
    /// All in f32 with 64-bit totals.
    pub const MIXED: Self = Self::all(Width::F32, UpdateWidth::Fixed64);
    /// All in f32.
    pub const F32: Self = Self::all(Width::F32, UpdateWidth::F32);

    /// One width for the loops and one for the totals.
    pub const fn all(width: Width, update: UpdateWidth) -> Self {
        Self { distance: width, log_score: width, normaliser: width, moments: width, update }
    }
}

impl SettingValue for Operations {
    fn parse(_: &OsStr) -> Result<Self, ValueError> {
        Err(ValueError::Text("expected `operations` in the file given by --config".to_owned()))
    }
}
