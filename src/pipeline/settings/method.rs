//! The settings of a model: the paper's or the scene's.

use super::scene::{SceneOverrides, SceneRun};
use crate::pipeline::any_preset::AnyPreset;
use crate::train::paper::config::{PaperConfig, Preset};
use serde::{Deserialize, Serialize};

/// How a model is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "preset", rename_all = "kebab-case")]
pub enum Method {
    /// The published algorithm.
    Paper(PaperConfig),
    /// Only what a scene needs.
    Scene(Box<SceneRun>),
}

impl Method {
    /// Its name.
    pub fn preset(&self) -> Preset {
        match self {
            Self::Paper(_) => Preset::Paper,
            Self::Scene(_) => Preset::Scene,
        }
    }

    /// Settings of either preset, for what does not depend on which it is.
    pub fn any(&self) -> &dyn AnyPreset {
        match self {
            Self::Paper(config) => config,
            Self::Scene(run) => &**run,
        }
    }
}

/// What a user asks for, before the dataset is looked at.
#[derive(Clone, Debug, PartialEq)]
pub enum MethodRequest {
    /// The published algorithm, with these settings.
    Paper(PaperConfig),
    /// The scene preset, with these settings of the user's own.
    Scene(SceneOverrides),
}

impl MethodRequest {
    /// Seed of every random stream.
    pub fn seed(&self) -> u64 {
        match self {
            Self::Paper(config) => config.seed,
            Self::Scene(overrides) => overrides.seed.unwrap_or(0),
        }
    }
}

impl From<PaperConfig> for MethodRequest {
    fn from(config: PaperConfig) -> Self {
        Self::Paper(config)
    }
}

impl From<SceneOverrides> for MethodRequest {
    fn from(overrides: SceneOverrides) -> Self {
        Self::Scene(overrides)
    }
}
