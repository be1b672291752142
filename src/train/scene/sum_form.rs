//! The arithmetic of a scene's sums.

use serde::{Deserialize, Serialize};
use strum::{EnumString, VariantNames};

/// How sums are kept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SumForm {
    /// Terms in f32, sums in integers: any order of points gives the same bits.
    Mixed,
    /// Terms and sums in f32.
    F32,
    /// All in f64: the oracle.
    F64,
}
