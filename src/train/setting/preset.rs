//! The presets by name.

use serde::{Deserialize, Serialize};
use strum::{Display, EnumString, VariantNames};

/// A named set of defaults, and the learner that they are for.
#[derive(
    Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize, Display, EnumString, VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Preset {
    /// The algorithm as published.
    Paper,
    /// Only what a scene needs.
    Scene,
}
