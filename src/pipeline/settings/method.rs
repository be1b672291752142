//! The settings of a model, the paper's or the scene's. Here and in `pipeline/start.rs` it is asked
//! which of the two; everybody else asks [`AnyPreset`].

use super::scene::{SceneOverrides, SceneRun};
use crate::dataset::Dataset;
use crate::pipeline::any_preset::AnyPreset;
use crate::pipeline::error::SessionError;
use crate::pipeline::plan::{Order, Plan, Selection};
use crate::train::paper::config::PaperConfig;
use crate::train::setting::Preset;
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

    /// The settings of a scene, for what only scenes have; `None` for a mixture.
    pub fn scene(&self) -> Option<&SceneRun> {
        match self {
            Self::Paper(_) => None,
            Self::Scene(run) => Some(run),
        }
    }

    /// Whether cameras are corrected by what is known of such cameras and not of these.
    pub fn assumes_calibration(&self, dataset: &Dataset) -> bool {
        let calibration = self.any().calibration();
        calibration.is_some() && calibration == dataset.known_calibration().as_ref()
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

    /// Settings that fit a dataset.
    ///
    /// # Errors
    /// [`SessionError`] for a setting out of range and for frames that a scene cannot begin with.
    pub(in crate::pipeline) fn on(
        self,
        dataset: &Dataset,
        selection: &Selection,
    ) -> Result<Method, SessionError> {
        if dataset.options.track {
            self.check_tracking(selection)?;
        }
        match self {
            Self::Paper(config) => Ok(Method::Paper(config)),
            Self::Scene(overrides) => {
                // Frames in their own order: whatever is found in them is the same in any order.
                let whole = Selection { order: Order::Sequential, ..selection.whole() };
                let all = Plan::new(dataset, &whole, overrides.seed.unwrap_or(0))?;
                Ok(Method::Scene(Box::new(SceneRun::new(dataset, &all, &overrides)?)))
            }
        }
    }
}

impl MethodRequest {
    /// Refuses what tracking cannot go with: each frame is placed by what those before it have
    /// taught, once.
    fn check_tracking(&self, selection: &Selection) -> Result<(), SessionError> {
        let refuse = |expected, found| Err(SessionError::Tracking { expected, found });
        match self {
            Self::Paper(_) => return refuse("--preset scene", "--preset paper".to_owned()),
            Self::Scene(SceneOverrides { births: Some(births), .. })
                if births.is_order_invariant() =>
            {
                return refuse("--births seeds", format!("--births {births}"));
            }
            Self::Scene(_) => {}
        }
        match selection {
            Selection { order: Order::Shuffled, .. } => {
                refuse("--order sequential", "--order shuffled".to_owned())
            }
            Selection { shard: Some(shard), .. } => {
                refuse("all frames in one run", format!("--shard {}", String::from(*shard)))
            }
            Selection { passes, .. } if *passes > 1 => {
                refuse("--passes 1", format!("--passes {passes}"))
            }
            _ => Ok(()),
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
