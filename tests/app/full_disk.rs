//! Writing to a full disk, simulated with `/dev/full`, where every write fails for lack of space.
#![cfg(target_os = "linux")]

use super::harness::{
    Window, click, dataset, train, wait, wait_for_label, wait_for_text, window, window_in, write_to,
};
use super::viewer::press;
use crate::common::adapter::turn;
use eframe::egui::Key;
use eframe::egui::accesskit::Role;
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::export;

/// Creates a file of this name whose writes fail as on a full disk.
fn on_a_full_disk(folder: &Path, name: &str) -> PathBuf {
    let file = folder.join(name);
    std::os::unix::fs::symlink("/dev/full", &file).unwrap();
    file
}

fn refusals(studio: &Studio, file: &Path) -> usize {
    let name = file.display().to_string();
    let is_meant = |text: &str| text.contains(&name) && text.contains("disk is full");
    let snapshot = studio.snapshot();
    let errors = snapshot.notices.iter().filter(|notice| notice.kind == NoticeKind::Error);
    errors.filter(|notice| is_meant(&notice.text)).count()
}

/// Writes over an existing file.
fn write_over(window: &mut Window, key: Key, button: &str, file: &Path) {
    write_to(window, key, button, file);
    wait_for_label(window, "Replace the existing file?");
    click(window, "Replace");
}

#[test]
fn a_full_disk_is_said_and_the_scene_is_written_elsewhere() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    for (key, button, name) in [
        (Key::S, "Save", "full.vbgs"),
        (Key::E, "Export", "full.ply"),
        (Key::E, "Export", "full.glb"),
    ] {
        let file = on_a_full_disk(folder.path(), name);
        write_over(&mut window, key, button, &file);
        wait(&mut window, "the refusal", |s| refusals(s, &file) == 1);
        let snapshot = window.state().snapshot();
        assert_eq!(
            (snapshot.state, snapshot.files.unsaved_frames),
            (RunState::Finished, 3),
            "{name}"
        );
        assert_eq!(
            snapshot.files.latest_write.map(|write| write.is_written),
            Some(false),
            "{name}"
        );
        // The dialog is open again, with the error and the name.
        window.run_steps(2);
        assert!(window.query_all_by_label_contains("disk is full").count() >= 2);
        assert_eq!(window.get_by_role(Role::TextInput).value(), Some(file.display().to_string()));
        press(&mut window, Key::Escape);
    }
    let elsewhere = folder.path().join("room.vbgs");
    write_to(&mut window, Key::S, "Save", &elsewhere);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    assert!(export::checkpoint::is_checkpoint(&elsewhere));
}

#[test]
fn a_history_that_cannot_be_stored_is_reported_once_with_its_folder() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 6);
    // A file is in the place of a folder, so that no user may write there.
    let none = folder.path().join("file");
    std::fs::write(&none, "").unwrap();
    let Some(mut window) = window_in(none.join("state"), Subject::Path(path)) else { return };
    train(&mut window);
    let is_meant = |text: &str| {
        text.starts_with("The history of this run ends at frame ")
            && text.contains(&none.display().to_string())
            && text.contains("free disk space")
    };
    let n_told = |studio: &Studio| {
        let notices = studio.snapshot().notices.clone();
        let warnings = notices.iter().filter(|notice| notice.kind == NoticeKind::Warning);
        warnings.filter(|notice| is_meant(&notice.text)).count()
    };
    wait(&mut window, "the notice", |s| n_told(s) > 0);
    // The panel of the history gives the reason, too, instead of an empty slider.
    click(&mut window, "Edit");
    wait_for_text(&mut window, "The history of this run ends at frame ");
    window.run_steps(20);
    assert_eq!(n_told(window.state()), 1);
    assert_eq!(window.state().snapshot().state, RunState::Finished);
}
