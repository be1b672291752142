//! Names of the presets.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// A named set of defaults and the learner they are for.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Preset {
    /// The published algorithm.
    Paper,
    /// Scene reconstruction: components are created as needed.
    Scene,
}
