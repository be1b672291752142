//! Writing to a full disk, simulated with `/dev/full`, where every write fails for lack of space.
#![cfg(target_os = "linux")]

use super::harness::{Window, click, dataset, train, wait, wait_for_label, window, write_to};
use crate::common::adapter::turn;
use eframe::egui::Key;
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
        assert_eq!((snapshot.state, snapshot.unsaved_frames), (RunState::Finished, 3), "{name}");
        assert_eq!(snapshot.latest_write.map(|write| write.is_written), Some(false), "{name}");
    }
    let elsewhere = folder.path().join("room.vbgs");
    write_to(&mut window, Key::S, "Save", &elsewhere);
    wait(&mut window, "the file", |s| s.snapshot().unsaved_frames == 0);
    assert!(export::checkpoint::is_checkpoint(&elsewhere));
}

#[test]
fn what_waits_for_a_file_is_given_up_on_a_full_disk_and_nothing_is_discarded() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    // At the path that the dialog proposes.
    let file = on_a_full_disk(folder.path(), "room.vbgs");
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    click(&mut window, "Demo");
    click(&mut window, "Save first…");
    window.run_steps(4);
    window.get_by_role_and_label(eframe::egui::accesskit::Role::Button, "Save").click();
    wait_for_label(&mut window, "Replace the existing file?");
    click(&mut window, "Replace");
    wait(&mut window, "the refusal", |s| refusals(s, &file) == 1);
    window.run_steps(4);
    let snapshot = window.state().snapshot();
    assert!(snapshot.opened.as_ref().is_some_and(|opened| !opened.is_demo));
    assert_eq!((snapshot.frames_done, snapshot.unsaved_frames), (2, 2));
}
