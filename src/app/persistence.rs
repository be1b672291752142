//! Settings stored between sessions: the parts of the settings file, each a RON text under its name.

use super::layout::WindowLayout;
use super::training::TrainSettings;
use super::user_folders::RecentPaths;
use super::viewer::settings::ViewSettings;
use crate::render::gpu::adapters::AdapterChoice;

const VIEWPORT: &str = "viewport";
const TRAINING: &str = "training";
const RECENT: &str = "recent";
const LAYOUT: &str = "layout";
/// Part with the adapter caveat that was already shown.
pub const CAVEAT: &str = "caveat";
/// Part with the adapter chosen for further windows.
pub const ADAPTER: &str = "adapter";
/// Part with the version of the file; a part may also have its own version.
pub const VERSION: &str = "version";
pub const FILE_VERSION: u32 = 2;

#[derive(Default)]
pub struct StoredSettings {
    pub view: ViewSettings,
    pub training: TrainSettings,
    pub recent: RecentPaths,
    pub layout: WindowLayout,
    pub problems: Vec<String>,
}

impl StoredSettings {
    /// Reads the settings of the previous session; `text` returns a part by its name.
    pub fn read(text: impl Fn(&str) -> Option<String>) -> Self {
        let mut stored = Self::default();
        if let Some(text) = text(VIEWPORT) {
            let (read, problem) = ViewSettings::from_text(&text);
            stored.view = read;
            stored.problems.extend(problem);
        }
        stored.recent = text(RECENT).map(|text| RecentPaths::from_text(&text)).unwrap_or_default();
        if let Some(text) = text(LAYOUT) {
            let (read, problem) = WindowLayout::from_text(&text);
            stored.layout = read;
            stored.problems.extend(problem);
        }
        if let Some(text) = text(TRAINING) {
            let (read, problem) = TrainSettings::from_text(&text);
            stored.training = read;
            stored.problems.extend(problem);
        }
        stored
    }
}

/// Stores the settings; without `adapter`, the adapter stored before is retained.
pub fn write(
    storage: &mut dyn eframe::Storage,
    view: &ViewSettings,
    training: &TrainSettings,
    recent: &RecentPaths,
    layout: &WindowLayout,
    adapter: Option<&AdapterChoice>,
) {
    storage.set_string(VERSION, FILE_VERSION.to_string());
    if let Some(adapter) = adapter {
        storage.set_string(ADAPTER, adapter.to_string());
    }
    let texts = [
        (VIEWPORT, view.to_text()),
        (TRAINING, training.to_text()),
        (RECENT, recent.to_text()),
        (LAYOUT, layout.to_text()),
    ];
    for (key, text) in texts {
        match text {
            Ok(text) => storage.set_string(key, text),
            Err(error) => tracing::warn!("storing the settings of {key} failed: {error}"),
        }
    }
}
