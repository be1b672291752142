//! The form in which the sums of a scene's components are kept: settings name it, the engine obeys.

use serde::{Deserialize, Serialize};
use strum::{EnumString, VariantNames};

/// Arithmetic and storage of the sums of every component.
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
