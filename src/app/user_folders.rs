//! Folders in the user's home to which the program writes without a prompt.

use std::path::PathBuf;

/// Name of the program's folder in each of them.
const APP: &str = "vbgs-studio";

/// Settings folder: `$XDG_CONFIG_HOME` or `~/.config`, else the platform's folder for application data.
pub fn config() -> Option<PathBuf> {
    by_convention("XDG_CONFIG_HOME", ".config")
}

/// State folder: `$XDG_STATE_HOME` or `~/.local/state`, else as [`config`].
pub fn state() -> Option<PathBuf> {
    by_convention("XDG_STATE_HOME", ".local/state")
}

/// Data folder, which held the settings file of version 1.
pub fn data() -> Option<PathBuf> {
    eframe::storage_dir(APP)
}

/// Folder named by a variable, else one in the user's home, on platforms with the XDG convention.
fn by_convention(variable: &str, in_home: &str) -> Option<PathBuf> {
    if !cfg!(all(unix, not(target_os = "macos"))) {
        return data();
    }
    let named = std::env::var_os(variable).map(PathBuf::from);
    let home = || std::env::home_dir().map(|home| home.join(in_home));
    // XDG requires relative paths to be ignored.
    named.filter(|path| path.is_absolute()).or_else(home).map(|path| path.join(APP))
}
