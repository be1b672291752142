//! What the user chose about training; kept between sessions. How a scene is trained applies to what
//! is opened or reset next, how often a run is saved at once.

use super::stored_text;
use crate::pipeline::settings::GivenSettings;
use crate::pipeline::settings::method::MethodRequest;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::PaperOverrides;
use crate::train::setting::{ConfigError, Preset};
use serde::{Deserialize, Serialize};

/// How what is opened next is trained.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrainSettings {
    /// The scene's preset or the paper's.
    pub preset: Preset,
    /// Settings of the scene preset.
    pub scene: SceneOverrides,
    /// Settings of the paper preset.
    pub paper: PaperOverrides,
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
            paper: PaperOverrides::default(),
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
    ///
    /// # Errors
    /// [`RefusedSetting`]: the panel takes nothing out of range, but stored settings may be written by
    /// hand.
    pub fn request(&self) -> Result<MethodRequest, RefusedSetting> {
        let Self { scene, paper, .. } = self.clone();
        GivenSettings { paper, scene }.request(self.preset).map_err(RefusedSetting)
    }
}

/// A setting that nothing can be trained with.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}; change it in Settings, under Training")]
pub struct RefusedSetting(ConfigError);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::{Candidates, PaperConfig, ReassignPolicy};
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
        let paper = PaperOverrides {
            components: Some(2000),
            candidates: Some(Candidates::Dense),
            reassign: Some(ReassignPolicy::Forwarded),
            ..PaperOverrides::default()
        };
        let chosen = TrainSettings { preset: Preset::Paper, scene, paper, autosave_s: None };
        assert_eq!(TrainSettings::from_text(&chosen.to_text().unwrap()), (chosen, None));
        for text in ["", "(preset: tomorrow)", "(scene: (scale: Some(\"-1\")))"] {
            let (read, notice) = TrainSettings::from_text(text);
            assert_eq!(read, TrainSettings::default(), "{text}");
            assert!(notice.unwrap().contains("the defaults are used"), "{text}");
        }
    }
    #[test]
    fn both_presets_are_asked_for_as_they_are_set_and_a_refusal_says_where() {
        let paper = PaperOverrides { components: Some(2000), ..PaperOverrides::default() };
        let mut chosen = TrainSettings { paper, ..TrainSettings::default() };
        assert_eq!(chosen.request(), Ok(chosen.scene.clone().into()));
        chosen.preset = Preset::Paper;
        let config = PaperConfig::paper().with(&chosen.paper).unwrap();
        assert_eq!((config.components, chosen.request()), (2000, Ok(config.into())));
        chosen.paper.components = Some(0);
        let refused = chosen.request().unwrap_err().to_string();
        assert!(refused.starts_with("components: expected 1 to"), "{refused}");
        assert!(refused.ends_with("found 0; change it in Settings, under Training"), "{refused}");
    }
}
