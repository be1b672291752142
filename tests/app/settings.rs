//! Location of the settings file, and handling of settings from a later version.

use super::harness::dataset;
use super::window::{Running, display};
use std::fs::{create_dir_all, read_to_string, write};
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};

/// Opens the window on a dataset and closes it; returns the log until the dataset was shown.
fn start_and_end(home: &Path, room: &Path) -> Vec<String> {
    let mut child = Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .arg(room)
        .env("HOME", home)
        .env("XDG_CONFIG_HOME", home.join("chosen"))
        .env_remove("XDG_DATA_HOME")
        .env("VBGS_LOG", "debug")
        .stderr(Stdio::piped())
        .spawn()
        .unwrap();
    let mut lines = BufReader::new(child.stderr.take().unwrap()).lines().map_while(Result::ok);
    let mut running = Running(child);
    let mut log = Vec::new();
    while log.last().is_none_or(|line: &String| !line.contains("shown: Ready")) {
        log.push(lines.next().unwrap_or_else(|| panic!("the program exited: {log:#?}")));
    }
    // A full pipe would keep the program from exiting, so the rest of the log is read too.
    std::thread::spawn(move || lines.for_each(drop));
    let status = running.ask_to_end();
    assert!(status.success(), "{status}: {log:#?}");
    log
}

#[test]
fn settings_lie_in_the_config_folder_and_a_newer_file_is_set_aside() {
    let Some(_) = display() else { return };
    let home = tempfile::tempdir().unwrap();
    let room = dataset(home.path(), 2);
    let folder = home.path().join("chosen/vbgs-studio");
    let file = folder.join("settings.ron");
    create_dir_all(&folder).unwrap();
    let newer = r#"{"version": "999", "layout": "(rooms: 4)"}"#;
    write(&file, newer).unwrap();
    let log = start_and_end(home.path(), &room);
    let is_told = |line: &String| line.contains("expected") && line.contains("version 999");
    assert!(log.iter().any(is_told), "{log:#?}");
    assert_eq!(read_to_string(folder.join("settings.ron.version-999")).unwrap(), newer);

    let text = read_to_string(&file).unwrap();
    let parts: std::collections::BTreeMap<String, String> = ron::from_str(&text).unwrap();
    assert_eq!(parts["version"], "2");
    for part in ["viewport", "training", "layout", "window"] {
        assert!(parts.contains_key(part), "{part} is missing in {text}");
    }
    assert!(parts["recent"].contains("room"), "{text}");
    assert!(folder.join("settings.ron.good").exists());
    assert!(!home.path().join(".local/share/vbgs-studio").exists(), "written to the old place");
    // The next window reads the file without a warning.
    let log = start_and_end(home.path(), &room);
    assert!(!log.iter().any(|line| line.contains("settings.ron")), "{log:#?}");
}
