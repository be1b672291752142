//! The adapter that the user chose last, kept in the platform's folder for settings: the one setting
//! that must be known before there is a window.

use crate::render::gpu::adapters::AdapterChoice;
use std::path::{Path, PathBuf};

/// Name of the application's folders, the same as eframe's.
pub const APP: &str = "vbgs-studio";
/// The file, a RON string.
const FILE: &str = "adapter.ron";

/// What was chosen last; wgpu's choice if nothing was, or if it cannot be read.
pub fn remembered() -> AdapterChoice {
    file().map_or(AdapterChoice::Auto, |file| read(&file))
}

/// Keeps a choice for the next start.
pub fn remember(choice: &AdapterChoice) {
    let Some(file) = file() else { return };
    if let Err(error) = write(&file, choice) {
        let file = file.display();
        tracing::warn!("{file}: the chosen adapter could not be kept for the next start: {error}");
    }
}

fn file() -> Option<PathBuf> {
    Some(eframe::storage_dir(APP)?.join(FILE))
}

fn read(file: &Path) -> AdapterChoice {
    // An error is told to nobody: there is no window yet, and the one that opens shows its adapter.
    let text = std::fs::read_to_string(file).ok();
    let name = text.and_then(|text| ron::from_str::<String>(&text).ok());
    name.map_or(AdapterChoice::Auto, |name| AdapterChoice::parse(&name))
}

fn write(file: &Path, choice: &AdapterChoice) -> std::io::Result<()> {
    if let Some(folder) = file.parent() {
        std::fs::create_dir_all(folder)?;
    }
    let text = ron::to_string(&choice.to_string()).map_err(std::io::Error::other)?;
    std::fs::write(file, text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_choice_is_kept_and_nonsense_counts_as_none() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("new").join(FILE);
        assert_eq!(read(&file), AdapterChoice::Auto);
        for choice in [AdapterChoice::Named("RTX \"9\"".into()), AdapterChoice::Software] {
            write(&file, &choice).unwrap();
            assert_eq!(read(&file), choice);
        }
        std::fs::write(&file, [0xff, 0x00]).unwrap();
        assert_eq!(read(&file), AdapterChoice::Auto);
    }
}
