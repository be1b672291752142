//! What the user chose, stored between sessions: the parts of the settings' file, each a text of RON under its
//! name.

use super::layout::WindowLayout;
use super::recent::RecentPaths;
use super::training::TrainSettings;
use super::viewer::settings::ViewSettings;
use crate::render::gpu::adapters::AdapterChoice;

/// Where settings are stored.
const VIEWPORT: &str = "viewport";
const TRAINING: &str = "training";
const RECENT: &str = "recent";
const LAYOUT: &str = "layout";
/// The caveat of an adapter that was told already.
pub const CAVEAT: &str = "caveat";
/// The adapter that was chosen for further windows.
pub const ADAPTER: &str = "adapter";
/// What the file's parts are and mean; a part may have a version of its own.
pub const VERSION: &str = "version";
/// Of the files that this program writes. The first had no part of this name and lay in another folder.
pub const FILE_VERSION: u32 = 2;

/// Everything that was stored.
#[derive(Default)]
pub struct StoredSettings {
    /// Settings of the viewport.
    pub view: ViewSettings,
    /// Settings of training.
    pub training: TrainSettings,
    /// Paths that were opened.
    pub recent: RecentPaths,
    /// What of the window is shown and where.
    pub layout: WindowLayout,
    /// What the user should know of what could not be read.
    pub problems: Vec<String>,
}

impl StoredSettings {
    /// Reads what the session before has left; `text` finds a part by its name.
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

/// Leaves settings for the next session; a chosen adapter too, else the one that was chosen before stays.
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
            Err(error) => tracing::warn!("the settings of {key} are not stored: {error}"),
        }
    }
}
