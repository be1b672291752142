//! Autosaved runs of a killed window: the next window offers to continue or forget them and never deletes
//! one without the user's consent.

use super::harness::{Window, click, dataset, is, step, until, wait, write_to};
use crate::common::adapter::{turn, vulkan};
use eframe::egui::{Key, Vec2, ViewportCommand, ViewportId};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Instant;
use vbgs_studio::app::rescue::Rescue;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::training::TrainSettings;
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Exit, Painting, Studio};
use vbgs_studio::dataset::LoadOptions;
use vbgs_studio::pipeline::checkpoint::SavedRun;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;

const FRAMES: usize = 4;

/// Starts a worker that autosaves as often as possible into `state`.
fn worker(state: &Path) -> Arc<Worker> {
    let worker = Worker::start_with(Arc::new(|| {}), vec![state.to_owned()]).unwrap();
    worker.send(always_saving());
    Arc::new(worker)
}

fn always_saving() -> WorkerOrder {
    let settings = TrainSettings { autosave_s: Some(0), ..TrainSettings::default() };
    WorkerOrder::TrainBy(Box::new(settings))
}

/// Lists the checkpoints in the autosave folder.
fn saved(state: &Path) -> Vec<PathBuf> {
    let Ok(entries) = std::fs::read_dir(state.join("autosave")) else { return Vec::new() };
    let paths = entries.map(|entry| entry.unwrap().path());
    let mut saved: Vec<PathBuf> =
        paths.filter(|path| path.extension().is_some_and(|e| e == "vbgs")).collect();
    saved.sort();
    saved
}

/// Creates the files that a window killed after two frames leaves. A window cannot be killed inside the test
/// process and removes its autosave on closing, so the content is read before and written back after.
fn killed(room: &Path, state: &Path) {
    let worker = worker(state);
    worker.send(WorkerOrder::Open(Subject::Path(room.to_owned())));
    for frames in 1..=2 {
        worker.send(WorkerOrder::Step);
        until("a frame", || worker.snapshot().frames_done == frames);
    }
    let has = |n: u64| {
        let files = saved(state);
        let run = files.first().and_then(|file| SavedRun::read(file).ok());
        run.is_some_and(|run| run.content.cursor.frames == n)
    };
    until("both frames to be saved", || has(2));
    let file = saved(state).remove(0);
    let content = std::fs::read(&file).unwrap();
    drop(worker);
    assert!(saved(state).is_empty(), "a window closed normally leaves no autosave");
    std::fs::write(file, content).unwrap();
}

/// Opens the next window on the same dataset; `None` without a Vulkan adapter.
fn next_window(room: &Path, state: &Path) -> Option<(Window, Arc<Worker>)> {
    vulkan()?;
    let worker = worker(state);
    let (own, room) = (worker.clone(), room.to_owned());
    let window = Harness::builder()
        .with_size(Vec2::new(1000.0, 640.0))
        .with_max_steps(8)
        .wgpu()
        .build_eframe(move |cc| {
            let first = vec![WorkerOrder::Open(Subject::Path(room))];
            Studio::attach(cc, own, first, Exit::default(), Painting::Auto, Instant::now()).unwrap()
        });
    // The window has set the autosave interval from its own settings.
    worker.send(always_saving());
    Some((window, worker))
}

#[test]
fn a_killed_run_is_offered_and_goes_on_to_the_same_scene() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, state) = (dataset(folder.path(), FRAMES), folder.path().join("state"));
    killed(&room, &state);
    let Some((mut window, worker)) = next_window(&room, &state) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    window.run_steps(2);
    window.get_by_label_contains("room was not saved: 2 of 4 frames are kept.");
    click(&mut window, "Open it");
    wait(&mut window, "the run", |s| s.snapshot().frames_done == 2);
    assert_eq!(window.state().snapshot().state, RunState::Paused);
    assert_eq!(window.state().snapshot().files.unsaved_frames, 2, "not yet saved by the user");
    assert!(window.query_by_label("Open it").is_none());

    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    let file = folder.path().join("run.vbgs");
    worker.send(WorkerOrder::Save(1, file.clone()));
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let opened = vbgs_studio::dataset::open(&room, &LoadOptions::default()).unwrap();
    let whole = SceneOverrides::default();
    let mut whole = Session::new(Arc::new(opened), whole, Selection::all_frames()).unwrap();
    while !matches!(whole.step().unwrap(), Step::Finished) {}
    let content = SavedRun::read(&file).unwrap().content;
    assert!(content.model == whole.checkpoint().unwrap().model, "another scene");
    assert!(saved(&state).is_empty(), "the autosave remains after the user's save");
}

#[test]
fn what_is_offered_survives_other_training_until_it_is_forgotten() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, state) = (dataset(folder.path(), FRAMES), folder.path().join("state"));
    killed(&room, &state);
    let left = saved(&state);
    let content = std::fs::read(&left[0]).unwrap();
    let Some((mut window, worker)) = next_window(&room, &state) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Later");
    assert!(window.query_by_label("Open it").is_none());
    step(&mut window);
    wait(&mut window, "a save", |_| saved(&state).len() == 2);
    assert!(
        std::fs::read(&left[0]).unwrap() == content,
        "the new run overwrote the offered autosave"
    );
    drop(window);
    drop(worker);
    assert_eq!(saved(&state), left, "only the offered autosave remains");

    let Some((mut window, _worker)) = next_window(&room, &state) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Delete it");
    wait(&mut window, "the file to go", |_| saved(&state).is_empty());
    window.run_steps(2);
    assert!(window.query_by_label("Open it").is_none());
}

/// `train` leaves a checkpoint in the state folder where its own folder is full.
#[test]
fn checkpoints_that_were_rescued_are_offered_like_unfinished_runs() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, state) = (dataset(folder.path(), FRAMES), folder.path().join("state"));
    killed(&room, &state);
    let slot = saved(&state).remove(0);
    let rescued = ["unsaved-4711.vbgs", "checkpoint-rescued.vbgs"].map(|name| state.join(name));
    for file in &rescued {
        std::fs::copy(&slot, file).unwrap();
    }
    std::fs::remove_file(slot).unwrap();
    // Not one of ours.
    std::fs::copy(&rescued[0], state.join("mine.vbgs")).unwrap();
    let n_left = || rescued.iter().filter(|file| file.exists()).count();
    let Some((mut window, _worker)) = next_window(&room, &state) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    window.run_steps(2);
    window.get_by_label_contains("room was not saved: 2 of 4 frames are kept.");
    click(&mut window, "Delete it");
    wait(&mut window, "the first file to go", |_| n_left() == 1);
    // The other one follows.
    click(&mut window, "Open it");
    wait(&mut window, "the run", |s| s.snapshot().frames_done == 2);
    assert_eq!(window.state().snapshot().files.unsaved_frames, 2, "not yet saved by the user");
    let file = folder.path().join("run.vbgs");
    write_to(&mut window, Key::S, "Save", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    until("the second file to go", || n_left() == 0);
    assert!(state.join("mine.vbgs").exists());
    window.run_steps(2);
    assert!(window.query_by_label("Open it").is_none());
}

#[test]
fn a_damaged_save_is_passed_over_for_the_one_before() {
    let folder = tempfile::tempdir().unwrap();
    let (room, state) = (dataset(folder.path(), FRAMES), folder.path().join("state"));
    killed(&room, &state);
    let file = saved(&state).remove(0);
    std::fs::copy(&file, file.with_added_extension("bak")).unwrap();
    std::fs::write(&file, "cut short").unwrap();
    let next = worker(&state);
    next.send(WorkerOrder::Open(Subject::Path(room.clone())));
    until("the dataset", || next.snapshot().state == RunState::Ready);
    let offered = next.snapshot().files.abandoned.clone().expect("an offer");
    assert_eq!(offered.frames, 2);
    assert_eq!((&offered.slot, &offered.file), (&file, &file.with_added_extension("bak")));
    next.send(WorkerOrder::ResumeAbandoned);
    until("the run", || next.snapshot().frames_done == 2);
}

/// The program is terminated from outside, with autosave off: the window closes without a question, and the
/// next one offers to continue.
#[test]
fn a_run_that_is_ended_from_outside_is_kept_and_offered() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, state) = (dataset(folder.path(), FRAMES), folder.path().join("state"));
    let Some((mut window, worker)) = next_window(&room, &state) else { return };
    let settings = TrainSettings { autosave_s: None, ..TrainSettings::default() };
    worker.send(WorkerOrder::TrainBy(Box::new(settings)));
    wait(&mut window, "ready", is(RunState::Ready));
    step(&mut window);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done == 1);
    let Rescue::Stored { path, frames } = worker.store() else { panic!("not kept") };
    assert_eq!(frames, 1);
    window.step();
    let commands = &window.output().viewport_output[&ViewportId::ROOT].commands;
    assert!(commands.contains(&ViewportCommand::Close), "{commands:?}");
    window.step();
    assert!(window.query_by_label_contains("Discard “").is_none());
    drop(window);
    drop(worker);
    assert_eq!(saved(&state), [path], "closing the window removed the stored run");

    let Some((mut window, _worker)) = next_window(&room, &state) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Open it");
    wait(&mut window, "the run", |s| s.snapshot().frames_done == 1);
}
