//! Settings stored between sessions: the parts of the settings file, each a RON text under its name.

use super::layout::WindowLayout;
use super::settings_file::from_text;
use super::training::TrainSettings;
use super::user_folders::RecentPaths;
use super::viewer::settings::ViewSettings;
use crate::render::gpu::adapters::AdapterChoice;

const VIEWPORT: &str = "viewport";
const TRAINING: &str = "training";
const RECENT: &str = "recent";
const LAYOUT: &str = "layout";
/// Name of the settings part that stores the last displayed warning about the adapter.
pub const CAVEAT: &str = "caveat";
/// Name of the settings part that stores the adapter chosen for further windows.
pub const ADAPTER: &str = "adapter";
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
    /// Reads the settings of the previous session. `text` returns the stored text of a part by its name.
    pub fn read(text: impl Fn(&str) -> Option<String>) -> Self {
        fn parsed<T: Default>(
            text: Option<String>,
            parse: impl Fn(&str) -> (T, Option<String>),
            problems: &mut Vec<String>,
        ) -> T {
            // At the first startup no part exists, which is not a problem.
            let (read, problem) = text.map(|text| parse(&text)).unwrap_or_default();
            problems.extend(problem);
            read
        }
        // Each part is read alone, so that an unreadable one leaves the others.
        let mut problems = Vec::new();
        let recent = |text: &str| from_text("recent paths", text);
        Self {
            view: parsed(text(VIEWPORT), ViewSettings::from_text, &mut problems),
            recent: parsed(text(RECENT), recent, &mut problems),
            layout: parsed(text(LAYOUT), WindowLayout::from_text, &mut problems),
            training: parsed(text(TRAINING), TrainSettings::from_text, &mut problems),
            problems,
        }
    }

    /// Stores the settings. If `adapter` is `None`, the previously stored adapter is kept.
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
        eframe::set_value(storage, VIEWPORT, view);
        eframe::set_value(storage, TRAINING, training);
        eframe::set_value(storage, RECENT, recent);
        eframe::set_value(storage, LAYOUT, layout);
    }
}
