//! Folders in the user's home to which the program writes without a prompt.

use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Name of the program's subfolder in the user's settings and state folders.
pub const APP: &str = "vbgs-studio";

/// Returns the settings folder: `$XDG_CONFIG_HOME` or `~/.config`, else the platform's folder for
/// application data.
pub fn config() -> Option<PathBuf> {
    by_convention("XDG_CONFIG_HOME", ".config")
}

/// Returns the state folder: `$XDG_STATE_HOME` or `~/.local/state`, else the same folder as [`config`].
pub fn state() -> Option<PathBuf> {
    by_convention("XDG_STATE_HOME", ".local/state")
}

/// Returns the program's folder within the folder that the environment variable `variable` contains,
/// otherwise within `in_home` in the user's home. Platforms without XDG folders use their folder for
/// application data.
fn by_convention(variable: &str, in_home: &str) -> Option<PathBuf> {
    if !cfg!(all(unix, not(target_os = "macos"))) {
        return eframe::storage_dir(APP);
    }
    let named = std::env::var_os(variable).map(PathBuf::from);
    let home = || std::env::home_dir().map(|home| home.join(in_home));
    // XDG requires relative paths to be ignored.
    named.filter(|path| path.is_absolute()).or_else(home).map(|path| path.join(APP))
}

const MAX_PATHS: usize = 8;

#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct RecentPaths(Vec<PathBuf>);

impl RecentPaths {
    pub fn paths(&self) -> &[PathBuf] {
        &self.0
    }

    pub fn note(&mut self, path: &Path) {
        self.0.retain(|known| known != path);
        self.0.insert(0, path.to_owned());
        self.0.truncate(MAX_PATHS);
    }
}

#[cfg(test)]
mod recent_tests {
    use super::*;

    #[test]
    fn the_newest_come_first_and_survive_a_restart() {
        let mut recent = RecentPaths::default();
        for i in [0, 1, 2, 3, 4, 5, 6, 7, 8, 4] {
            recent.note(Path::new(&format!("/rooms/{i} a")));
        }
        let names = [4, 8, 7, 6, 5, 3, 2, 1].map(|i| PathBuf::from(format!("/rooms/{i} a")));
        assert_eq!(recent.paths(), names);
        let read = ron::from_str::<RecentPaths>(&ron::to_string(&recent).unwrap());
        assert_eq!(read.ok(), Some(recent));
    }
}
