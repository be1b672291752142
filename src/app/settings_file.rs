//! Settings file in the user's configuration folder: RON with a version, and recovery if it cannot be read.
//!
//! eframe reads and writes the file as named parts ([`StoredSettings`]). It empties the
//! file before writing, so that a full disk or a power cut leaves a partial file. It ignores an unreadable
//! file without a message and overwrites it. Therefore a file that this version cannot read is renamed
//! before the first window opens. A copy of the last valid file replaces it, and the user is warned.

use super::layout::WindowLayout;
use super::training::TrainSettings;
use super::user_folders;
use super::user_folders::RecentPaths;
use super::viewer::settings::ViewSettings;
use crate::export::ExportError;
use crate::export::atomic::write_atomic;
use crate::render::gpu::adapters::AdapterChoice;
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

const FILE: &str = "settings.ron";
const VIEWPORT: &str = "viewport";
const TRAINING: &str = "training";
const RECENT: &str = "recent";
const LAYOUT: &str = "layout";
/// Name of the settings part that stores the last displayed warning about the adapter.
pub const CAVEAT: &str = "caveat";
/// Name of the settings part that stores the adapter chosen for further windows.
const ADAPTER: &str = "adapter";
const VERSION: &str = "version";
const FILE_VERSION: u32 = 2;
/// Maximum size of the settings file, bytes. Usual files have some kilobytes.
const MAX_BYTES: u64 = 1 << 26;

/// Content of the settings file: the text of each part by its name.
type Parts = BTreeMap<String, String>;

pub struct SettingsFile {
    file: PathBuf,
}

/// Settings that are read before the first window opens.
#[derive(Debug, Default, PartialEq)]
pub struct FoundSettings {
    pub adapter: Option<AdapterChoice>,
    pub problems: Vec<String>,
}

enum Unusable {
    Missing,
    Unread(io::Error),
    /// The content is invalid; holds the description of the error.
    Broken(String),
    Newer(u32),
}

impl SettingsFile {
    /// Returns the user's settings file; `None` if the platform has no configuration folder.
    pub fn of_user() -> Option<Self> {
        Some(Self { file: user_folders::config()?.join(FILE) })
    }

    pub fn path(&self) -> &Path {
        &self.file
    }

    /// Reads the file before the first window opens. A file that is broken or of a newer version is
    /// renamed and replaced by the last valid copy.
    pub fn open(&self) -> FoundSettings {
        let (parts, problem) = match read(&self.file) {
            Ok(parts) => (Some(parts), None),
            Err(unusable) => self.replace(&unusable),
        };
        let parts = parts.unwrap_or_default();
        let adapter = parts.get(ADAPTER).map(|name| AdapterChoice::parse(name));
        let problems = problem.into_iter().chain(self.back_up_unreadable_parts(&parts)).collect();
        FoundSettings { adapter, problems }
    }

    /// Backs up a valid settings file. Replaces a broken one by its backup and returns a notice. Called
    /// after the last window has closed, so that startup does not wait for the disk.
    pub fn close(&self) -> Option<String> {
        match read(&self.file) {
            Ok(parts) => {
                if let Err(error) = write(&self.good(), &parts) {
                    tracing::warn!("the copy of the settings was not kept: {error}");
                }
                None
            }
            Err(broken @ Unusable::Broken(_)) => self.replace(&broken).1,
            Err(Unusable::Missing | Unusable::Unread(_) | Unusable::Newer(_)) => None,
        }
    }

    fn good(&self) -> PathBuf {
        self.file.with_added_extension("good")
    }

    /// Renames an unusable file and replaces it by the last valid copy. Returns the content of the copy
    /// and a notice.
    fn replace(&self, unusable: &Unusable) -> (Option<Parts>, Option<String>) {
        let place = self.file.display();
        let (expected, found, aside, advice) = match unusable {
            Unusable::Missing => return (None, None),
            Unusable::Unread(error) => {
                let text = format!(
                    "{place}: expected a settings file, found that it cannot be read: {error}; the defaults are used; delete it or make it readable"
                );
                return (None, Some(text));
            }
            Unusable::Broken(found) => (
                "the settings that the last window wrote".to_owned(),
                found.clone(),
                "broken".to_owned(),
                "the disk may have been full: make room, and settings are saved again",
            ),
            Unusable::Newer(version) => (
                format!("settings of version {FILE_VERSION}"),
                format!("version {version}"),
                format!("version-{version}"),
                "rename it back before you start the newer program",
            ),
        };
        let aside = self.file.with_added_extension(aside);
        if let Err(error) = std::fs::rename(&self.file, &aside) {
            let text = format!(
                "{place}: expected {expected}, found {found}, and it cannot be renamed: {error}; the defaults are used and this window overwrites it: copy it or delete it"
            );
            return (None, Some(text));
        }
        let good = self.good();
        // Renamed, not copied: the disk may still be full.
        let parts = read(&good).ok().filter(|_| std::fs::rename(&good, &self.file).is_ok());
        let used = match &parts {
            Some(_) => "those of the previous start are used",
            None => "the defaults are used",
        };
        let aside = aside.display();
        let text = format!(
            "{place}: expected {expected}, found {found}; {used}, the file was renamed to {aside}; {advice}"
        );
        (parts, Some(text))
    }

    /// Copies the whole file if a part cannot be read, because the window would overwrite such a part by
    /// its default. Returns a notice.
    fn back_up_unreadable_parts(&self, parts: &Parts) -> Option<String> {
        let stored = StoredSettings::read(|part| parts.get(part).cloned());
        if stored.problems.is_empty() {
            return None;
        }
        let aside = self.file.with_added_extension("unread");
        let (place, shown) = (self.file.display(), aside.display());
        Some(match std::fs::copy(&self.file, &aside) {
            Ok(_) => {
                format!("{place}: a part cannot be read; the original file was copied to {shown}")
            }
            Err(error) => format!(
                "{place}: a part cannot be read, and copying the original file to {shown} failed: {error}"
            ),
        })
    }
}

fn read(file: &Path) -> Result<Parts, Unusable> {
    let metadata = file.metadata().map_err(|error| match error.kind() {
        io::ErrorKind::NotFound => Unusable::Missing,
        _ => Unusable::Unread(error),
    })?;
    // A folder or device of this name cannot be replaced by the settings.
    if !metadata.is_file() {
        return Err(Unusable::Unread(io::Error::other("it is not a file")));
    }
    // Checked before reading, to bound the memory.
    if metadata.len() > MAX_BYTES {
        return Err(Unusable::Broken(format!("{} bytes", metadata.len())));
    }
    // Invalid UTF-8 makes the file unusable, like a missing end.
    let bytes = std::fs::read(file).map_err(Unusable::Unread)?;
    parse(&String::from_utf8_lossy(&bytes))
}

/// Parses the text in the same way as eframe.
fn parse(text: &str) -> Result<Parts, Unusable> {
    if text.trim().is_empty() {
        return Err(Unusable::Broken("an empty file".to_owned()));
    }
    let parts: Parts = ron::from_str(text).map_err(|error| Unusable::Broken(error.to_string()))?;
    match parts.get(VERSION).map(|version| version.parse::<u32>()) {
        Some(Ok(version)) if version > FILE_VERSION => Err(Unusable::Newer(version)),
        None | Some(Ok(_)) => Ok(parts),
        Some(Err(error)) => Err(Unusable::Broken(format!("an invalid version: {error}"))),
    }
}

fn write(file: &Path, parts: &Parts) -> Result<(), ExportError> {
    let text = ron::ser::to_string_pretty(parts, ron::ser::PrettyConfig::default());
    // A missing folder is reported by the write below.
    let _ = file.parent().map(std::fs::create_dir_all);
    write_atomic(file, |out| out.write_all(text.map_err(io::Error::other)?.as_bytes())).map(drop)
}

/// Returns `path` if it does not exist, otherwise the first unused path with a number before the extension.
pub fn unused(path: &Path) -> PathBuf {
    let stem = path.file_stem().unwrap_or_default().to_string_lossy();
    let ending = path.extension().unwrap_or_default().to_string_lossy();
    let numbered = (2..).map(|n| path.with_file_name(format!("{stem}-{n}.{ending}")));
    let mut paths = std::iter::once(path.to_owned()).chain(numbered);
    // The fallback is never used, because the numbers have no end.
    paths.find(|path| !path.exists()).unwrap_or_else(|| path.to_owned())
}

/// Parses a part of the settings. `what` names the part in messages. Unreadable text yields the default
/// and a notice, because settings of another version must not prevent the window from opening.
pub fn from_text<T: DeserializeOwned + Default>(what: &str, text: &str) -> (T, Option<String>) {
    match ron::from_str(text) {
        Ok(read) => (read, None),
        Err(error) => {
            let notice = format!(
                "the stored settings of {what}: expected the format of this version, found {error}; the defaults are used instead"
            );
            (T::default(), Some(notice))
        }
    }
}

/// Settings stored between sessions: the parts of the file, each a RON text under its name.
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::app::viewer::settings::ViewSettings;
    use tempfile::TempDir;

    const GOOD: &str = r#"{"version": "2", "adapter": "RTX \"9\""}"#;

    /// Creates a home folder without a settings folder.
    fn home() -> (TempDir, SettingsFile) {
        let home = tempfile::tempdir().unwrap();
        let file = home.path().join("config").join(FILE);
        (home, SettingsFile { file })
    }

    fn put(settings: &SettingsFile, text: &str) {
        std::fs::create_dir_all(settings.file.parent().unwrap()).unwrap();
        std::fs::write(&settings.file, text).unwrap();
    }

    fn beside(settings: &SettingsFile, extension: &str) -> Option<String> {
        std::fs::read_to_string(settings.file.with_added_extension(extension)).ok()
    }

    /// Opens the settings and checks that there is one notice, which contains these words.
    fn problem(settings: &SettingsFile, words: &[&str]) -> Option<AdapterChoice> {
        let FoundSettings { adapter, problems } = settings.open();
        let [problem] = &problems[..] else { panic!("{problems:?}") };
        let place = settings.file.display().to_string();
        for part in [place.as_str(), "expected", "found"].iter().chain(words) {
            assert!(problem.contains(part), "{part:?} is missing in: {problem}");
        }
        adapter
    }

    fn named() -> Option<AdapterChoice> {
        Some(AdapterChoice::Named("RTX \"9\"".into()))
    }

    #[test]
    fn half_a_file_gives_way_to_the_last_good_one_and_is_kept() {
        for broken in ["", "{\"layout\": \"(vers", "\u{0}\u{0}", r#"{"version": "new"}"#] {
            let (_home, settings) = home();
            assert_eq!(settings.open(), FoundSettings::default(), "none was written yet");
            assert_eq!(settings.close(), None);
            put(&settings, GOOD);
            let good = FoundSettings { adapter: named(), problems: vec![] };
            assert_eq!(settings.open(), good);
            assert_eq!(settings.close(), None);
            put(&settings, broken);
            let words = ["previous start", "settings.ron.broken", "make room"];
            assert_eq!(problem(&settings, &words), named());
            assert_eq!(beside(&settings, "broken").as_deref(), Some(broken));
            assert_eq!(settings.open(), good, "reported once");
            // Like a last window that met a full disk, which only the log reports.
            assert_eq!(settings.close(), None);
            put(&settings, broken);
            assert!(settings.close().unwrap().contains("previous start"));
            assert_eq!(settings.open(), good);
        }
    }

    #[test]
    fn without_a_good_one_the_defaults_are_used() {
        let (_home, settings) = home();
        put(&settings, "no RON at all");
        assert_eq!(problem(&settings, &["the defaults are used"]), None);
        assert!(!settings.file.exists());
        assert_eq!(settings.open(), FoundSettings::default());
    }

    #[test]
    fn a_newer_file_is_set_aside_as_it_is_and_said() {
        let newer = r#"{"version": "3", "adapter": "software", "rooms": "(4)"}"#;
        for good in [None, Some(GOOD)] {
            let (_home, settings) = home();
            if let Some(good) = good {
                put(&settings, good);
                settings.close();
            }
            put(&settings, newer);
            let words = ["version 3", "version 2", "settings.ron.version-3"];
            assert_eq!(problem(&settings, &words), good.and_then(|_| named()));
            assert_eq!(beside(&settings, "version-3").as_deref(), Some(newer));
        }
    }

    #[test]
    fn a_part_that_cannot_be_read_leaves_a_copy_of_the_file() {
        let (_home, settings) = home();
        let view = ron::to_string(&ViewSettings::default()).unwrap();
        let whole = Parts::from([("viewport".to_owned(), view)]);
        write(&settings.file, &whole).ok().unwrap();
        assert_eq!(settings.open(), FoundSettings::default());
        let text = r#"{"version": "2", "viewport": "(by a hand that slipped"}"#;
        put(&settings, text);
        let told = settings.open().problems;
        assert!(told[0].contains("settings.ron.unread"), "{told:?}");
        assert_eq!(beside(&settings, "unread").as_deref(), Some(text));
    }

    #[test]
    fn what_is_no_file_is_said_and_left() {
        let (_home, settings) = home();
        std::fs::create_dir_all(&settings.file).unwrap();
        assert_eq!(problem(&settings, &["cannot be read"]), None);
        assert!(settings.file.is_dir());
    }

    #[test]
    fn older_files_keep_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("room.latency.csv");
        for name in ["room.latency.csv", "room.latency-2.csv", "room.latency-3.csv"] {
            let free = unused(&path);
            assert_eq!(free, folder.path().join(name));
            std::fs::write(free, "").unwrap();
        }
    }
}
