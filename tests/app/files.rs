//! Writing scenes and runs, and opening them again.

use super::harness::{
    click, dataset, enter_path, is, press_in_dialog, step, train, until, wait, window, write_to,
};
use crate::common::adapter::turn;
use eframe::egui::{Key, Modifiers};
use std::path::Path;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, Weak};
use vbgs_studio::app::Painting;
use vbgs_studio::app::edit::marks::LeftOut;
use vbgs_studio::app::export_options::ExportKind;
use vbgs_studio::app::state::{Notice, NoticeKind, RunState, Source, Subject};
use vbgs_studio::app::worker::{Export, Waker, Worker, WorkerOrder};
use vbgs_studio::export;
use vbgs_studio::export::SpzVersion;
use vbgs_studio::export::mapping::Mapping;

#[test]
fn export_writes_the_newest_state_and_the_file_opens_again() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);

    let file = folder.path().join("scene.glb");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let n_splats = export::read(&file).unwrap().splats.len();
    // Splats with a texture become several.
    wait(&mut window, "splats", |s| (1..=n_splats).contains(&s.n_drawn()));

    drop(window);
    let Some(mut viewer) = self::window(Some(Subject::Path(file)), Painting::Auto) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    wait(&mut viewer, "splats", |s| s.n_drawn() == n_splats);
}

#[test]
fn meshes_and_point_clouds_are_exported_too() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 3));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    train(&mut window);
    for (n, kind, name) in [(1, "Mesh", "mesh.obj"), (2, "Point cloud", "points.ply")] {
        window.key_press_modifiers(Modifiers::COMMAND, Key::E);
        window.run_steps(2);
        click(&mut window, kind);
        let file = folder.path().join(name);
        enter_path(&mut window, &file);
        press_in_dialog(&mut window, "Export");
        wait(&mut window, name, |s| {
            s.snapshot().files.latest_write.is_some_and(|w| w.is_written && w.number >= n)
        });
        let text = String::from_utf8_lossy(&std::fs::read(&file).unwrap()).into_owned();
        let n_lines = |start: &str| text.lines().filter(|line| line.starts_with(start)).count();
        match kind {
            "Mesh" => assert!(n_lines("v ") > 100 && n_lines("f ") > 100),
            _ => assert!(text.contains("property uchar red") && !text.contains("scale_0")),
        }
    }
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
    step(&mut window);
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    let file = folder.path().join("run.vbgs");
    write_to(&mut window, Key::S, "Save", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    let used = window.state().snapshot().model.used;
    let drawn = window.state().n_drawn();
    assert!(drawn <= used, "{drawn} of {used}");
    drop(window);

    let open = |file: &Path| self::window(Some(Subject::Path(file.to_owned())), Painting::Auto);
    let Some(mut again) = open(&file) else { return };
    wait(&mut again, "the run", is(RunState::Paused));
    let snapshot = again.state().snapshot();
    assert_eq!(
        (snapshot.source, snapshot.frames_done, snapshot.model.used),
        (Source::Dataset, 1, used)
    );
    wait(&mut again, "splats", |s| s.n_drawn() == drawn);
    again.key_press(Key::Space);
    wait(&mut again, "the end", is(RunState::Finished));
    assert_eq!(again.state().snapshot().frames_done, 4);
    drop(again);

    std::fs::rename(&path, folder.path().join("elsewhere")).unwrap();
    let Some(mut viewer) = open(&file) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    let told =
        viewer.state().snapshot().notices.iter().any(|n| n.text.contains("cannot be resumed"));
    assert!(told, "no notice explains why the run cannot be resumed");
    wait(&mut viewer, "splats", |s| s.n_drawn() == drawn);
}

/// Cancelling takes effect between two blocks of rows and leaves an existing file unchanged.
#[test]
fn an_export_is_given_up_when_the_user_says_so() {
    let folder = tempfile::tempdir().unwrap();
    let worker: Arc<Mutex<Weak<Worker>>> = Arc::default();
    let (seen, patient) = (Arc::new(AtomicBool::new(false)), worker.clone());
    let shown = seen.clone();
    // The writing thread calls the waker whenever its progress changes.
    let waker: Waker = Arc::new(move || {
        let worker = patient.lock().unwrap().upgrade();
        if let Some(worker) = worker.filter(|worker| worker.file_progress().is_some()) {
            shown.store(true, Ordering::SeqCst);
            worker.cancel_file();
        }
    });
    let started = Worker::start_with(waker, vec![folder.path().join("state")]).unwrap();
    let started = Arc::new(started);
    *worker.lock().unwrap() = Arc::downgrade(&started);
    let room = dataset(folder.path(), 2);
    started.send(WorkerOrder::Open(Subject::Path(room)));
    started.send(WorkerOrder::Train);
    until("the end", || started.snapshot().state == RunState::Finished);
    let file = folder.path().join("scene.ply");
    std::fs::write(&file, "older").unwrap();
    started.send(WorkerOrder::Export(Export {
        number: 1,
        path: file.clone(),
        kind: ExportKind::default(),
        mapping: Mapping::default(),
        spz_version: SpzVersion::default(),
        left_out: LeftOut::default(),
    }));
    let is_told = |n: &Notice| n.kind == NoticeKind::Info && n.text.contains("cancelled");
    until("the message", || started.snapshot().notices.iter().any(is_told));
    assert!(seen.load(Ordering::SeqCst));
    assert_eq!(std::fs::read(&file).unwrap(), b"older");
    let outcome = started.snapshot().files.latest_write.unwrap();
    assert_eq!((outcome.number, outcome.is_written), (1, false));
    assert_eq!(started.file_progress(), None);
}
