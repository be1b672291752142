//! Training settings chosen by the user, stored between sessions. They apply to the next dataset that is
//! opened or reset; the autosave interval applies at once.

use super::settings_file;
use crate::dataset::LoadOptions;
use crate::pipeline::autosave;
use crate::pipeline::settings::GivenSettings;
use crate::pipeline::settings::method::MethodRequest;
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::paper::config::PaperOverrides;
use crate::train::scene::units::StructuralScale;
use crate::train::setting::{ConfigError, Preset};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct TrainSettings {
    pub preset: Preset,
    pub scene: SceneOverrides,
    pub paper: PaperOverrides,
    /// Autosave interval, seconds; `None` disables autosave.
    pub autosave_s: Option<u32>,
    /// Settings of single datasets, newest first.
    pub datasets: Vec<(PathBuf, DatasetSettings)>,
}

/// Settings that belong to a single dataset.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct DatasetSettings {
    pub scale: Option<StructuralScale>,
    /// How its files are read.
    pub reading: LoadOptions,
}

/// Maximum number of datasets whose settings are stored.
const MAX_DATASETS: usize = 50;

impl Default for TrainSettings {
    fn default() -> Self {
        Self {
            preset: Preset::Scene,
            scene: SceneOverrides::default(),
            paper: PaperOverrides::default(),
            autosave_s: Some(autosave::DEFAULT_S),
            datasets: Vec::new(),
        }
    }
}

impl TrainSettings {
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        settings_file::from_text("training", text)
    }

    /// Returns these settings with the structural scale that was chosen for a dataset, or the default one.
    /// `None` is the demo.
    pub fn for_dataset(&self, path: Option<&Path>) -> Self {
        let mut settings = self.clone();
        settings.scene.scale = path.and_then(|path| self.of_dataset(path).scale);
        settings
    }

    /// Returns the settings stored for a dataset.
    pub fn of_dataset(&self, path: &Path) -> DatasetSettings {
        let known = self.datasets.iter().find(|(of, _)| of == path);
        known.map_or_else(DatasetSettings::default, |(_, settings)| *settings)
    }

    /// Changes the settings stored for a dataset.
    pub fn note(&mut self, path: &Path, change: impl FnOnce(&mut DatasetSettings)) {
        let mut settings = self.of_dataset(path);
        change(&mut settings);
        self.datasets.retain(|(of, _)| of != path);
        if settings != DatasetSettings::default() {
            self.datasets.insert(0, (path.to_owned(), settings));
            self.datasets.truncate(MAX_DATASETS);
        }
    }

    /// Returns the training method with these settings, for a new session. Fails if a value is out of
    /// range, which is possible because stored settings may be edited by hand.
    pub fn request(&self) -> Result<MethodRequest, RefusedSetting> {
        let Self { scene, paper, .. } = self.clone();
        GivenSettings { paper, scene }.request(self.preset).map_err(RefusedSetting)
    }
}

#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}; change it in Settings, under Training")]
pub struct RefusedSetting(ConfigError);

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::paper::config::{Candidates, PaperConfig, ReassignPolicy};
    use crate::train::scene::units::Budget;

    #[test]
    fn settings_survive_a_restart() {
        let scene = SceneOverrides {
            scale: Some(StructuralScale::Pixels(3.5)),
            refine: Some(false),
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
        let scale = Some(StructuralScale::Pixels(1.5));
        let reading = LoadOptions { track: true, ..LoadOptions::default() };
        let datasets = vec![(PathBuf::from("/rooms/a"), DatasetSettings { scale, reading })];
        let chosen =
            TrainSettings { preset: Preset::Paper, scene, paper, autosave_s: None, datasets };
        assert_eq!(TrainSettings::from_text(&ron::to_string(&chosen).unwrap()), (chosen, None));
        for text in ["", "(preset: tomorrow)", "(scene: (scale: Some(\"-1\")))"] {
            let (read, notice) = TrainSettings::from_text(text);
            assert_eq!(read, TrainSettings::default(), "{text}");
            assert!(notice.unwrap().contains("the defaults are used"), "{text}");
        }
    }

    #[test]
    fn a_level_of_detail_belongs_to_one_dataset() {
        let mut settings = TrainSettings::default();
        let [a, b] = ["/rooms/a", "/rooms/b"].map(Path::new);
        settings.note(a, |of| of.scale = Some(StructuralScale::Pixels(4.0)));
        assert_eq!(settings.for_dataset(None).scene.scale, None);
        assert_eq!(settings.for_dataset(Some(b)).scene.scale, None);
        assert_eq!(settings.for_dataset(Some(a)).scene.scale, Some(StructuralScale::Pixels(4.0)));
        settings.note(a, |of| of.scale = None);
        assert_eq!(settings.datasets, []);
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
