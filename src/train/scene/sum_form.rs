//! Arithmetic of a scene's sums.

use serde::{Deserialize, Serialize};
use strum::{EnumString, VariantNames};

/// Number format of the sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, EnumString, VariantNames)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum SumForm {
    /// Terms in f32, sums in integers: the same bits for any order of points.
    Mixed,
    /// Terms and sums in f32.
    F32,
    /// Terms and sums in f64, the reference.
    F64,
}
