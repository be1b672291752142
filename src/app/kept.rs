//! What the user chose, kept between sessions.

use super::training::TrainSettings;
use super::viewer::settings::ViewSettings;
use serde::de::DeserializeOwned;

/// Where settings are kept.
const VIEWPORT: &str = "viewport";
const TRAINING: &str = "training";

/// Everything that was kept.
#[derive(Default)]
pub struct Kept {
    /// Settings of the viewport.
    pub view: ViewSettings,
    /// Settings of training.
    pub training: TrainSettings,
    /// What the user should know of what could not be read.
    pub problems: Vec<String>,
}

impl Kept {
    /// Reads what the session before has left.
    pub fn read(storage: Option<&dyn eframe::Storage>) -> Self {
        let mut kept = Self::default();
        let text = |key| storage.and_then(|storage| storage.get_string(key));
        if let Some(text) = text(VIEWPORT) {
            let (read, problem) = ViewSettings::from_text(&text);
            kept.view = read;
            kept.problems.extend(problem);
        }
        if let Some(text) = text(TRAINING) {
            let (read, problem) = TrainSettings::from_text(&text);
            kept.training = read;
            kept.problems.extend(problem);
        }
        kept
    }
}

/// Leaves settings for the next session.
pub fn write(storage: &mut dyn eframe::Storage, view: &ViewSettings, training: &TrainSettings) {
    for (key, text) in [(VIEWPORT, view.to_text()), (TRAINING, training.to_text())] {
        match text {
            Ok(text) => storage.set_string(key, text),
            Err(error) => tracing::warn!("the settings of {key} are not kept: {error}"),
        }
    }
}

/// Reads settings of `what`. What cannot be read falls back to the defaults, with a text that says so.
pub fn from_text<T: DeserializeOwned + Default>(what: &str, text: &str) -> (T, Option<String>) {
    match ron::from_str(text) {
        Ok(read) => (read, None),
        Err(error) => {
            let notice = format!(
                "the stored settings of {what}: expected what this version writes, found {error}; the defaults are used instead"
            );
            (T::default(), Some(notice))
        }
    }
}
