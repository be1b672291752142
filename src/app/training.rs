//! What the user chose about training; kept between sessions. How a scene is trained applies to what
//! is opened or reset next, how often a run is saved at once.

use super::stored_text;
use crate::pipeline::settings::method::MethodRequest;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::PaperConfig;
use crate::train::setting::Preset;
use serde::{Deserialize, Serialize};

/// How what is opened next is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrainSettings {
    /// The scene's preset or the paper's.
    pub preset: Preset,
    /// Settings of the scene preset.
    pub scene: SceneOverrides,
    /// Seconds from one save on the way to the next; `None` saves on request only.
    pub autosave_s: Option<u32>,
}

/// Seconds from one save on the way to the next, unless the user chose others: what a crash may cost,
/// while a save of a large scene takes a second or two of the disk.
pub const AUTOSAVE_S: u32 = 30;

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            preset: Preset::Scene,
            scene: SceneOverrides::default(),
            autosave_s: Some(AUTOSAVE_S),
        }
    }
}

impl TrainSettings {
    /// Reads what an earlier session wrote by [`Self::to_text`]. What cannot be read falls back to
    /// the defaults, with a text that says so.
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        stored_text::from_text("training", text)
    }

    /// For the next session.
    pub fn to_text(&self) -> Result<String, ron::Error> {
        ron::to_string(self)
    }

    /// What a session is asked for.
    pub fn request(&self) -> MethodRequest {
        match self.preset {
            Preset::Paper => PaperConfig::paper().into(),
            Preset::Scene => self.scene.clone().into(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::scene::config::BirthRule;
    use crate::train::scene::units::{Budget, StructuralScale};

    #[test]
    fn settings_survive_a_restart() {
        let scene = SceneOverrides {
            scale: Some(StructuralScale::Pixels(3.5)),
            births: Some(BirthRule::BodyCentred),
            budget: Some(Budget::Components(9000)),
            cosine: Some(false),
            ..SceneOverrides::default()
        };
        let chosen = TrainSettings { preset: Preset::Paper, scene, autosave_s: None };
        assert_eq!(TrainSettings::from_text(&chosen.to_text().unwrap()), (chosen, None));
        for text in ["", "(preset: tomorrow)", "(scene: (scale: Some(\"-1\")))"] {
            let (read, notice) = TrainSettings::from_text(text);
            assert_eq!(read, TrainSettings::default(), "{text}");
            assert!(notice.unwrap().contains("the defaults are used"), "{text}");
        }
    }
}
