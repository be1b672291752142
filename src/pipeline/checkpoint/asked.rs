//! Settings a user gives beside a checkpoint: they must be the ones the run was begun with.

use super::error::RunError;
use super::saved::SavedRun;
use crate::dataset::LoadOptions;
use crate::pipeline::plan::{Order, Shard};
use crate::pipeline::settings::method::Method;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::{PaperOverrides, Preset};
use serde::Serialize;
use serde_json::Value;

/// What a user asks of a run that goes on; what is not asked for is as it was.
#[derive(Clone, Debug, Default, Serialize)]
pub struct Asked {
    /// Origin of the defaults.
    pub preset: Option<Preset>,
    /// Settings of a model of the paper's preset.
    #[serde(skip)]
    pub paper: PaperOverrides,
    /// Settings of a model of the scene's.
    #[serde(skip)]
    pub scene: SceneOverrides,
    /// Split to train on.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Option<Order>,
    /// Every so-many-th frame.
    pub stride: Option<usize>,
    /// Share of the frames.
    pub shard: Option<Shard>,
    /// How depth files are read.
    #[serde(flatten)]
    pub load: LoadOptions,
    /// Frames at most, those gone through included: the one setting that may change.
    #[serde(skip)]
    pub max_frames: Option<usize>,
}

/// Settings of either preset that have the same option.
const SHARED: [&str; 3] = ["seed", "precision", "sums"];

impl SavedRun {
    /// Refuses the first setting that contradicts the run's.
    pub fn check(&self, asked: &Asked) -> Result<(), RunError> {
        let [paper, scene] =
            [serde_json::to_value(&asked.paper), serde_json::to_value(&asked.scene)];
        let (own, foreign) = match &self.config.method {
            Method::Paper(_) => (paper, scene),
            Method::Scene(_) => (scene, paper),
        };
        let (Ok(Value::Object(asked)), Ok(Value::Object(own)), Ok(Value::Object(foreign))) =
            (serde_json::to_value(asked), own, foreign)
        else {
            return Ok(()); // settings are always JSON objects
        };
        let Ok(stored) = serde_json::to_value(&self.config) else { return Ok(()) };
        let closes = stored["native"]["closing"].as_f64().map(|coverage| coverage < 1.0);
        let closes = Value::from(closes);
        // What one option says to both presets is judged by the run's own.
        let foreign = foreign.iter().filter(|(name, _)| !SHARED.contains(&name.as_str()));
        let given = asked.iter().chain(&own).chain(foreign).filter(|(_, value)| !value.is_null());
        for (name, value) in given {
            let before = match name.as_str() {
                "covariance_form" => &stored["conversion"]["form"],
                "scale_factor" => &stored["conversion"]["scale_factor"],
                "gradient" | "directional" => &stored["native"][name],
                "closing" => &closes,
                "plane_fit" | "flying_pixels" | "cosine" | "sensor" | "calibration" => {
                    &stored["surface"][name]
                }
                other => &stored[other],
            };
            if before != value {
                return Err(RunError::Conflict {
                    setting: option_name(name),
                    path: self.path.clone(),
                    stored: if before.is_null() { "no such option".into() } else { text(before) },
                    asked: text(value),
                });
            }
        }
        Ok(())
    }
}

/// As the command line spells it.
fn option_name(name: &str) -> String {
    match name {
        "covariance_form" => "--conversion".to_owned(),
        "sums" => "--precision".to_owned(),
        "refine" | "align" | "gain" | "closing" | "gradient" | "directional" | "plane_fit"
        | "flying_pixels" | "cosine" => format!("--with or --without {}", name.replace('_', "-")),
        other => format!("--{}", other.replace('_', "-")),
    }
}

fn text(value: &Value) -> String {
    value.as_str().map_or_else(|| value.to_string(), str::to_owned)
}
