//! Panics of the program: the report, and what becomes of the run. Tests inject them through egui's hooks
//! and the waker, so the program needs no code for it.

use super::device_loss::draw_film;
use super::harness::{PATIENCE, Window, dataset, is, step, train, until, wait, wait_for_label};
use crate::common::adapter::{turn, vulkan};
use eframe::egui::{Key, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, OnceLock, Weak};
use std::time::Instant;
use vbgs_studio::app::edit::marks::LeftOut;
use vbgs_studio::app::export_options::ExportKind;
use vbgs_studio::app::rescue::{CrashedThread, Rescue};
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::app::worker::{Export, Waker, Worker, WorkerOrder};
use vbgs_studio::app::{Exit, ExitReason, Painting, Studio, WindowError, run_guarded};
use vbgs_studio::export;
use vbgs_studio::export::SpzVersion;
use vbgs_studio::export::mapping::Mapping;
use vbgs_studio::pipeline::checkpoint::SavedRun;

/// A window on a worker that outlives it, as in the program.
struct Hosted {
    window: Window,
    worker: Arc<Worker>,
    exit: Exit,
    device: wgpu::Device,
}

/// Opens a window on a new worker; `None` without a Vulkan adapter. Runs are stored below `folder`.
fn hosted(subject: Subject, waker: Waker, folder: &Path) -> Option<Hosted> {
    vulkan()?;
    let worker = Arc::new(Worker::start_with(waker, vec![folder.to_owned()]).unwrap());
    let exit = Exit::default();
    let (window, device) =
        attached(&worker, &exit, vec![WorkerOrder::Open(subject)], Painting::Auto);
    Some(Hosted { window, worker, exit, device })
}

/// Opens a window on a worker; returns it with its device, which a test can destroy.
pub fn attached(
    worker: &Arc<Worker>,
    exit: &Exit,
    first: Vec<WorkerOrder>,
    painting: Painting,
) -> (Window, wgpu::Device) {
    let device = Arc::new(Mutex::new(None));
    let (own, word, found) = (worker.clone(), exit.clone(), device.clone());
    let window = Harness::builder()
        .with_size(Vec2::new(1000.0, 640.0))
        .with_max_steps(8)
        .wgpu()
        .build_eframe(move |cc| {
            *found.lock().unwrap() = cc.wgpu_render_state.as_ref().map(|s| s.device.clone());
            Studio::attach(cc, own, first, word, painting, Instant::now()).unwrap()
        });
    let device = device.lock().unwrap().take().unwrap();
    (window, device)
}

/// Makes the window panic at its next pass; returns the program's result.
fn panic_in(window: Window, worker: &Worker, exit: &Exit) -> Result<(), WindowError> {
    window.ctx.on_begin_pass("test", Arc::new(|_| panic!("injected into the window")));
    let started = Instant::now();
    run_guarded(worker, exit, || {
        let mut window = window;
        loop {
            window.step();
            assert!(started.elapsed() < PATIENCE, "the window does not panic");
        }
    })
}

#[test]
fn a_panic_of_the_window_stores_the_run_and_states_where() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let state = folder.path().join("state");
    let Some(mut hosted) = hosted(Subject::Path(path), Arc::new(|| {}), &state) else { return };
    wait(&mut hosted.window, "ready", is(RunState::Ready));
    step(&mut hosted.window);
    wait(&mut hosted.window, "a frame", |s| s.snapshot().frames_done == 1);

    let Hosted { window, worker, exit, .. } = hosted;
    let Err(WindowError::Crashed(crash)) = panic_in(window, &worker, &exit) else {
        panic!("a crash")
    };
    assert_eq!(crash.thread, CrashedThread::Window);
    let Rescue::Stored { path: saved, frames: 1 } = crash.rescue.clone() else { panic!("{crash}") };
    assert!(saved.starts_with(state.join("autosave")), "{crash}");
    let text = crash.to_string();
    for part in ["injected into the window", "crash.rs:", &saved.display().to_string()] {
        assert!(text.contains(part), "{text}");
    }
    drop(worker);
    assert!(saved.is_file(), "the end of the worker removed the stored run");

    let Some(mut again) = super::harness::window(Some(Subject::Path(saved)), Painting::Auto) else {
        return;
    };
    wait(&mut again, "the run", is(RunState::Paused));
    assert_eq!(again.state().snapshot().frames_done, 1);
}

#[test]
fn a_panic_after_the_device_was_lost_is_the_devices_loss() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut hosted) = hosted(Subject::Path(path), Arc::new(|| {}), folder.path()) else {
        return;
    };
    train(&mut hosted.window);
    let Hosted { window, worker, exit, device } = hosted;
    device.destroy();
    let ended = panic_in(window, &worker, &exit);
    assert!(ended.is_ok(), "{ended:?}");
    assert_eq!(exit.reason.get(), ExitReason::DeviceLost);
    assert!(worker.crash().is_none());
    assert!(!folder.path().join("autosave").exists(), "training goes on");
    assert_eq!(worker.snapshot().files.unsaved_frames, 3, "in the next window");
}

#[test]
fn a_panic_of_training_stores_the_run_and_leaves_the_window() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let state = folder.path().join("state");
    let armed = Arc::new(AtomicBool::new(false));
    let trigger = armed.clone();
    let waker: Waker = Arc::new(move || {
        assert!(!trigger.swap(false, Ordering::SeqCst), "injected into training");
    });
    let path = dataset(folder.path(), 30);
    let Some(mut hosted) = hosted(Subject::Path(path), waker, &state) else { return };
    let Hosted { window, worker, .. } = &mut hosted;
    wait(window, "ready", is(RunState::Ready));
    for frames in 1..=2 {
        step(window);
        wait(window, "a frame", |s| s.snapshot().frames_done == frames);
    }
    armed.store(true, Ordering::SeqCst);
    worker.send(WorkerOrder::Inspect(None));
    wait(window, "the crash", is(RunState::Failed));
    let crash = worker.crash().unwrap();
    assert_eq!(crash.thread, CrashedThread::Training);
    let Rescue::Stored { path, frames: 2 } = &crash.rescue else { panic!("{crash}") };
    assert!(path.starts_with(&state) && path.is_file(), "{crash}");
    assert!(crash.to_string().contains("injected into training"), "{crash}");
    wait_for_label(window, &crash.to_string());
    wait(window, "splats", |s| s.n_drawn() > 100);
    assert!(window.get_by_label("Export").rect().is_positive());
    assert!(worker.is_alive());
    assert_eq!(worker.store(), crash.rescue, "the run is stored once");
}

/// Makes the next pool thread that wakes the window panic, once. Pool threads are those without a name.
fn panic_of_film(window: &Window) -> Arc<AtomicBool> {
    let armed = Arc::new(AtomicBool::new(true));
    let trigger = armed.clone();
    window.ctx.set_request_repaint_callback(move |_| {
        let is_meant = std::thread::current().name() == Some("film");
        assert!(!(is_meant && trigger.swap(false, Ordering::SeqCst)), "injected into a film");
    });
    armed
}

#[test]
fn a_panic_of_a_film_costs_the_film_and_is_told() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut hosted) = hosted(Subject::Path(path), Arc::new(|| {}), folder.path()) else {
        return;
    };
    let Hosted { window, worker, .. } = &mut hosted;
    train(window);
    wait(window, "splats", |s| s.n_drawn() > 100);
    let armed = panic_of_film(window);
    draw_film(window, &folder.path().join("film"));
    wait(window, "the error notice", |s| {
        let told = |text: &str| text.contains("injected into a film") && text.contains("report it");
        s.snapshot().notices.iter().any(|n| n.kind == NoticeKind::Error && told(&n.text))
    });
    assert!(!armed.load(Ordering::SeqCst) && worker.crash().is_none());
    // The dialog stays with the error. A second film is rendered normally.
    window.key_press(Key::Escape);
    window.run_steps(2);
    draw_film(window, &folder.path().join("again"));
    let second = folder.path().join("again/00002.png");
    wait(window, "pictures", |_| second.exists());
}

/// Starts a worker that has trained one frame; it panics while `armed` is set.
fn stepped_worker(room: PathBuf, folders: &[&Path], armed: &Arc<AtomicBool>) -> Worker {
    let trigger = armed.clone();
    let waker: Waker = Arc::new(move || assert!(!trigger.load(Ordering::SeqCst), "injected"));
    let folders = folders.iter().map(|folder| folder.to_path_buf()).collect();
    let worker = Worker::start_with(waker, folders).unwrap();
    worker.send(WorkerOrder::Open(Subject::Path(room)));
    worker.send(WorkerOrder::Step);
    until("a frame", || worker.snapshot().frames_done == 1);
    worker
}

/// Checks that a run of one frame is stored below `folder`; returns its path.
fn stored(rescue: &Rescue, folder: &Path) -> PathBuf {
    let Rescue::Stored { path, frames: 1 } = rescue else { panic!("{rescue}") };
    assert!(path.starts_with(folder.join("autosave")), "{rescue}");
    assert_eq!(SavedRun::read(path).unwrap().content.cursor.frames, 1);
    path.clone()
}

#[test]
fn a_run_is_stored_once_in_the_first_folder_that_takes_it() {
    let folder = tempfile::tempdir().unwrap();
    let (file, state) = (folder.path().join("file"), folder.path().join("state"));
    std::fs::write(&file, "").unwrap();
    let room = dataset(folder.path(), 3);
    let worker = stepped_worker(room, &[&file, &state], &Arc::default());
    let rescue = worker.store();
    let path = stored(&rescue, &state);
    assert_eq!(worker.store(), rescue, "the same state is stored once");
    assert!(worker.snapshot().is_terminated);

    let run = folder.path().join("run.vbgs");
    worker.send(WorkerOrder::Save(1, run.clone()));
    until("the file", || worker.snapshot().files.latest_write.is_some_and(|w| w.is_written));
    assert!(run.is_file() && !path.exists(), "the user's file replaces the stored run");
}

#[test]
fn a_run_that_no_folder_takes_is_lost_and_every_reason_is_given() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("file");
    std::fs::write(&file, "").unwrap();
    let room = dataset(folder.path(), 3);
    let worker = stepped_worker(room, &[&file, &file.join("more")], &Arc::default());
    let Rescue::Lost { frames: 1, problems } = worker.store() else { panic!("lost") };
    assert_eq!(problems.len(), 2, "{problems:?}");
}

#[test]
fn a_second_panic_ends_the_thread_and_the_run_stays_stored() {
    let folder = tempfile::tempdir().unwrap();
    let armed = Arc::new(AtomicBool::new(false));
    let worker = stepped_worker(dataset(folder.path(), 3), &[folder.path()], &armed);
    armed.store(true, Ordering::SeqCst);
    worker.send(WorkerOrder::Inspect(None));
    until("the end", || !worker.is_alive());
    let crash = worker.crash().unwrap();
    assert_eq!(crash.thread, CrashedThread::Training);
    assert!(crash.panic.place.as_ref().is_some_and(|place| place.contains("crash.rs")));
    assert_eq!(worker.store(), crash.rescue, "known although the thread has ended");
    drop(worker);
    stored(&crash.rescue, folder.path());
}

#[test]
fn a_panic_while_a_file_is_written_keeps_the_older_file_and_the_run() {
    let folder = tempfile::tempdir().unwrap();
    let known: Arc<OnceLock<Weak<Worker>>> = Arc::default();
    let (writer, told) = (known.clone(), AtomicBool::new(false));
    // Panics once, while the trainer writes a file.
    let waker: Waker = Arc::new(move || {
        let writer = writer.get().and_then(Weak::upgrade);
        let writes = writer.is_some_and(|writer| writer.file_progress().is_some());
        assert!(!writes || told.swap(true, Ordering::SeqCst), "injected into a file");
    });
    let worker = Arc::new(Worker::start_with(waker, vec![folder.path().to_owned()]).unwrap());
    worker.send(WorkerOrder::Open(Subject::Path(dataset(folder.path(), 3))));
    worker.send(WorkerOrder::Step);
    let file = folder.path().join("scene.ply");
    std::fs::write(&file, "older").unwrap();
    until("a frame", || worker.snapshot().frames_done == 1);
    known.set(Arc::downgrade(&worker)).unwrap();
    let order = |number| {
        WorkerOrder::Export(Export {
            number,
            path: file.clone(),
            kind: ExportKind::default(),
            mapping: Mapping::default(),
            spz_version: SpzVersion::default(),
            left_out: LeftOut::default(),
        })
    };
    worker.send(order(1));
    until("the crash", || worker.crash().is_some());
    let crash = worker.crash().unwrap();
    stored(&crash.rescue, folder.path());
    assert!(crash.panic.message.contains("injected into a file"), "{crash}");
    assert_eq!(std::fs::read(&file).unwrap(), b"older");
    assert!(worker.file_progress().is_none(), "nothing is being written any more");

    worker.send(order(2));
    until("the file", || worker.snapshot().files.latest_write.is_some_and(|w| w.is_written));
    assert!(export::read(&file).is_ok(), "the scene is still there to be exported");
    let names = std::fs::read_dir(folder.path()).unwrap().map(|f| f.unwrap().file_name());
    let temporary = names.filter(|name| name.to_string_lossy().ends_with(".tmp"));
    assert_eq!(temporary.count(), 0);
}

#[test]
fn nothing_is_written_where_nothing_was_unsaved() {
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 3);
    let worker = stepped_worker(room, &[folder.path()], &Arc::default());
    worker.send(WorkerOrder::Save(1, folder.path().join("run.vbgs")));
    assert_eq!(worker.store(), Rescue::Nothing);
    assert_eq!(worker.snapshot().state, RunState::Paused);
    assert!(!folder.path().join("autosave").exists());
}
