//! Guards the file of settings against disks that were full.
//!
//! eframe empties the file and then writes it, so that a full disk or a power cut leaves half of it; what it
//! cannot read it passes over without a word. So a copy of the last good file is kept beside it, takes its
//! place where it is broken, and the user is told.

use super::adapter_memory::APP;
use crate::export::atomic::write_atomic;
use std::collections::BTreeMap;
use std::io;
use std::path::{Path, PathBuf};

/// eframe's file.
const FILE: &str = "app.ron";
/// Largest one that is read: it holds some kilobytes.
const MAX_BYTES: u64 = 1 << 26;

/// The user's file, where the platform has a folder for it.
pub fn file_of_user() -> Option<PathBuf> {
    Some(eframe::storage_dir(APP)?.join(FILE))
}

/// Keeps a copy of the file where it is whole: when the last window is closed, since a start waits for no
/// disk.
pub fn keep(file: &Path) {
    let good = good_of(file);
    let Some(text) = read(file).ok().filter(|text| parse(text).is_ok()) else { return };
    if read(&good).ok().as_ref() != Some(&text)
        && let Err(error) = write_atomic(&good, |out| out.write_all(text.as_bytes()))
    {
        tracing::warn!("the copy of the settings was not kept: {error}");
    }
}

fn good_of(file: &Path) -> PathBuf {
    file.with_added_extension("good")
}

/// Puts the last good file in the place of a broken one, which is set aside. What the user is to know.
pub fn mend(file: &Path) -> Option<String> {
    let text = match read(file) {
        Ok(text) => text,
        // None was written yet; or it cannot be read at all, which eframe logs and no copy mends.
        Err(_) => return None,
    };
    let good = good_of(file);
    let Err(problem) = parse(&text) else { return None };
    let broken = file.with_added_extension("broken");
    let aside = broken.display();
    if let Err(error) = std::fs::rename(file, &broken) {
        return Some(format!(
            "{}: expected the settings that the last window wrote, found {problem}, and it cannot be set aside: {error}; the defaults are used, delete the file",
            file.display()
        ));
    }
    // A new name for the copy, and no other copy: the disk may still be full.
    let is_good = read(&good).is_ok_and(|text| parse(&text).is_ok());
    let used = match is_good && std::fs::rename(&good, file).is_ok() {
        true => "those of the start before are used",
        false => "the defaults are used",
    };
    Some(format!(
        "{}: expected the settings that the last window wrote, found {problem}; {used}, the file is set aside as {aside}. The disk may have been full: make room, and settings are kept again",
        file.display()
    ))
}

fn read(file: &Path) -> io::Result<String> {
    let metadata = file.metadata()?;
    if !metadata.is_file() || metadata.len() > MAX_BYTES {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    // Bytes that are no text break the file as well as a missing end does.
    Ok(String::from_utf8_lossy(&std::fs::read(file)?).into_owned())
}

/// As eframe reads it.
fn parse(text: &str) -> Result<(), String> {
    if text.trim().is_empty() {
        return Err("an empty file".to_owned());
    }
    let read: Result<BTreeMap<String, String>, _> = ron::from_str(text);
    read.map(drop).map_err(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use super::*;

    const GOOD: &str = r#"{"layout": "(version: 2)"}"#;

    #[test]
    fn half_a_file_gives_way_to_the_last_good_one_and_is_kept() {
        for broken in ["", "{\"layout\": \"(vers", "\u{0}\u{0}"] {
            let folder = tempfile::tempdir().unwrap();
            let file = folder.path().join(FILE);
            assert_eq!(mend(&file), None, "none was written yet");
            std::fs::write(&file, GOOD).unwrap();
            assert_eq!(mend(&file), None);
            keep(&file);
            std::fs::write(&file, broken).unwrap();
            keep(&file);
            let told = mend(&file).unwrap();
            for part in [FILE, "expected", "found", "start before", "app.ron.broken", "make room"] {
                assert!(told.contains(part), "{part:?} is missing in: {told}");
            }
            assert_eq!(std::fs::read_to_string(&file).unwrap(), GOOD);
            let aside = folder.path().join("app.ron.broken");
            assert_eq!(std::fs::read_to_string(aside).unwrap(), broken);
            assert_eq!(mend(&file), None, "told once");
        }
    }

    #[test]
    fn without_a_good_one_the_defaults_are_used() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join(FILE);
        std::fs::write(&file, "no RON at all").unwrap();
        assert!(mend(&file).unwrap().contains("the defaults are used"));
        assert!(!file.exists());
        assert_eq!(mend(&file), None);
    }
}
