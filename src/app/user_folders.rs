//! Folders of the user's home that the program writes to by itself.

use std::path::PathBuf;

/// Name of the program's own folder in each of them.
const APP: &str = "vbgs-studio";

/// For settings: `$XDG_CONFIG_HOME` or `~/.config`, else where the platform has programs keep what is theirs.
pub fn config() -> Option<PathBuf> {
    by_convention("XDG_CONFIG_HOME", ".config")
}

/// For what programs remember by themselves: `$XDG_STATE_HOME` or `~/.local/state`, else as [`config`].
pub fn state() -> Option<PathBuf> {
    by_convention("XDG_STATE_HOME", ".local/state")
}

/// For data, where versions before 2 of the settings' file kept it.
pub fn data() -> Option<PathBuf> {
    eframe::storage_dir(APP)
}

/// The folder that a variable names, or one in the user's home, where the platform has the convention.
fn by_convention(variable: &str, in_home: &str) -> Option<PathBuf> {
    if !cfg!(all(unix, not(target_os = "macos"))) {
        return data();
    }
    let named = std::env::var_os(variable).map(PathBuf::from);
    let home = || std::env::home_dir().map(|home| home.join(in_home));
    // The convention has relative paths ignored.
    named.filter(|path| path.is_absolute()).or_else(home).map(|path| path.join(APP))
}
