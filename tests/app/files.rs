//! Scenes and runs that are written and opened again.

use super::harness::{click, dataset, is, train, wait, window, write_to};
use crate::common::adapter::turn;
use eframe::egui::Key;
use std::path::Path;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Source, Subject};
use vbgs_studio::export;

#[test]
fn export_writes_the_newest_state_and_the_file_opens_again() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);

    let file = folder.path().join("scene.glb");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().unsaved_frames == 0);
    let n_splats = export::read(&file).unwrap().splats.len();
    wait(&mut window, "splats", |s| s.n_drawn() == n_splats);

    drop(window);
    let Some(mut viewer) = self::window(Some(Subject::Path(file)), Painting::Auto) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    wait(&mut viewer, "splats", |s| s.n_drawn() == n_splats);
}

#[test]
fn a_saved_run_opens_where_it_stopped_and_goes_on() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let Some(mut window) = window(Some(Subject::Path(path.clone())), Painting::Auto) else {
        return;
    };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Step");
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    let file = folder.path().join("run.vbgs");
    write_to(&mut window, Key::S, "Save", &file);
    wait(&mut window, "the file", |s| s.snapshot().unsaved_frames == 0);
    let used = window.state().snapshot().used;
    let drawn = window.state().n_drawn();
    assert!(drawn > 100 && drawn <= used, "{drawn} of {used}");
    drop(window);

    let open = |file: &Path| self::window(Some(Subject::Path(file.to_owned())), Painting::Auto);
    let Some(mut again) = open(&file) else { return };
    wait(&mut again, "the run", is(RunState::Paused));
    let snapshot = again.state().snapshot();
    assert_eq!((snapshot.source, snapshot.frames_done, snapshot.used), (Source::Dataset, 1, used));
    wait(&mut again, "splats", |s| s.n_drawn() == drawn);
    again.key_press(Key::Space);
    wait(&mut again, "the end", is(RunState::Finished));
    assert_eq!(again.state().snapshot().frames_done, 4);
    drop(again);

    std::fs::rename(&path, folder.path().join("elsewhere")).unwrap();
    let Some(mut viewer) = open(&file) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    let told = viewer.state().snapshot().notices.iter().any(|n| n.text.contains("cannot go on"));
    assert!(told, "why it cannot be trained");
    wait(&mut viewer, "splats", |s| s.n_drawn() == drawn);
}
