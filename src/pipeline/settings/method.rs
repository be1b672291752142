//! Settings of a model of either preset. Code that treats both presets alike uses [`AnyPreset`].

use super::scene::{SceneOverrides, SceneRun};
use crate::dataset::Dataset;
use crate::pipeline::any_preset::AnyPreset;
use crate::pipeline::error::SessionError;
use crate::pipeline::memory;
use crate::pipeline::plan::{Order, Plan, Selection};
use crate::train::paper::config::PaperConfig;
use crate::train::setting::Preset;
use serde::{Deserialize, Serialize};

/// Preset of a run, with its settings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(tag = "preset", rename_all = "kebab-case")]
pub enum Method {
    /// The published algorithm.
    Paper(PaperConfig),
    /// The scene preset.
    Scene(Box<SceneRun>),
}

impl Method {
    /// Preset of the settings.
    pub fn preset(&self) -> Preset {
        match self {
            Self::Paper(_) => Preset::Paper,
            Self::Scene(_) => Preset::Scene,
        }
    }

    /// Returns the settings through an interface that is independent of the preset.
    pub fn as_any(&self) -> &dyn AnyPreset {
        match self {
            Self::Paper(config) => config,
            Self::Scene(run) => &**run,
        }
    }

    /// Returns the settings as [`Self::as_any`] does, for changes.
    pub(in crate::pipeline) fn as_any_mut(&mut self) -> &mut dyn AnyPreset {
        match self {
            Self::Paper(config) => config,
            Self::Scene(run) => &mut **run,
        }
    }

    /// Settings of a scene; `None` for the paper preset.
    pub fn scene(&self) -> Option<&SceneRun> {
        match self {
            Self::Paper(_) => None,
            Self::Scene(run) => Some(run),
        }
    }

    /// True if cameras are corrected by the default calibration of their camera model, not by an
    /// individual calibration.
    pub fn assumes_calibration(&self, dataset: &Dataset) -> bool {
        let calibration = self.as_any().calibration();
        calibration.is_some() && calibration == dataset.known_calibration().as_ref()
    }
}

/// Requested preset and settings, before they are fitted to a dataset.
#[derive(Clone, Debug, PartialEq)]
pub enum MethodRequest {
    /// The published algorithm, with these settings.
    Paper(PaperConfig),
    /// The scene preset, with the user's settings.
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

    /// True if the settings contain a calibration of the photographs' camera.
    pub fn has_color_camera(&self) -> bool {
        match self {
            Self::Paper(_) => false,
            Self::Scene(SceneOverrides { calibration, .. }) => {
                calibration.as_ref().is_some_and(|given| given.color_camera.is_some())
            }
        }
    }

    /// Fits the settings to a dataset and to the machine's memory. Each frame has at most `pixels` pixels.
    ///
    /// # Errors
    /// [`SessionError`] for a setting out of range, for frames from which a scene cannot start, or for too
    /// little memory.
    pub(in crate::pipeline) fn fit_to_dataset(
        self,
        dataset: &Dataset,
        selection: &Selection,
        pixels: usize,
    ) -> Result<Method, SessionError> {
        if dataset.options.track {
            self.check_tracking(selection)?;
        }
        match self {
            Self::Paper(mut config) => {
                memory::fit(&mut config, pixels)?;
                Ok(Method::Paper(config))
            }
            Self::Scene(overrides) => {
                // In sequential order, so that the estimates do not depend on the order of training.
                let whole = Selection { order: Order::Sequential, ..selection.without_shard() };
                let all = Plan::new(dataset, &whole, overrides.seed.unwrap_or(0))?;
                let mut run = SceneRun::without_scale(dataset, &all, &overrides)?;
                // Before frames are sampled for the scale, which takes memory too.
                memory::fit(&mut run, pixels)?;
                Ok(Method::Scene(Box::new(run.with_scale(dataset, &all)?)))
            }
        }
    }

    /// Returns an error for settings that are incompatible with tracking, which estimates each pose from
    /// earlier frames.
    fn check_tracking(&self, selection: &Selection) -> Result<(), SessionError> {
        let refuse = |expected, found| Err(SessionError::Tracking { expected, found });
        match self {
            Self::Paper(_) => return refuse("--preset scene", "--preset paper".to_owned()),
            Self::Scene(_) => {}
        }
        match selection {
            Selection { order: Order::Shuffled, .. } => {
                refuse("order=sequential", "order=shuffled".to_owned())
            }
            Selection { shard: Some(shard), .. } => {
                refuse("all frames in one run", format!("--shard {}", String::from(*shard)))
            }
            Selection { passes, .. } if *passes > 1 => {
                refuse("passes=1", format!("passes={passes}"))
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
