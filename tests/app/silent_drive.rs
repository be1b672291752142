//! Folders on a drive that does not respond.
#![cfg(target_os = "linux")]

use super::harness::{
    PATIENCE, Window, click, dataset, drag, drop_on, is, live, settled, train, until, wait,
    wait_for_label, wait_for_picture, window, write_to,
};
use super::viewer::press;
use crate::common::adapter::turn;
use crate::common::silent::{SilentFile, image_of_holes};
use eframe::egui::{Key, PointerButton};
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};

/// Longest duration of one pass in these tests, far below the timeout of a drive.
const PASS: Duration = Duration::from_secs(2);

/// A dataset with one file that blocks until the end of the test.
struct Silent {
    folder: PathBuf,
    _file: SilentFile,
}

impl Silent {
    /// Writes a dataset that blocks while opening; `None` if files cannot be blocked outside strict mode.
    fn new(scratch: &Path) -> Option<Self> {
        let network = scratch.join("network");
        std::fs::create_dir(&network).unwrap();
        Self::of(scratch, dataset(&network, 2), "transforms_train.json")
    }

    /// Blocks a file of a dataset from now on.
    fn of(scratch: &Path, folder: PathBuf, file: &str) -> Option<Self> {
        let file = SilentFile::hold(scratch, &folder.join(file))?;
        Some(Self { folder, _file: file })
    }
}

fn told(studio: &Studio, kind: NoticeKind, parts: &[&str]) -> bool {
    let snapshot = studio.snapshot();
    let has = |text: &str| parts.iter().all(|part| text.contains(part));
    snapshot.notices.iter().any(|notice| notice.kind == kind && has(&notice.text))
}

/// Drops the folder on the window, confirms discarding a trained scene, and waits for loading to start.
fn waits_for(window: &mut Window, silent: &Silent) {
    let asks = window.state().snapshot().has_training_to_lose();
    drop_on(window, &silent.folder);
    if asks {
        click(window, "Discard");
    }
    wait(window, "the start of opening", is(RunState::Loading));
}

#[test]
fn a_drive_that_does_not_answer_is_named_and_given_up_and_nothing_is_lost() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(silent) = Silent::new(folder.path()) else { return };
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    wait_for_picture(&mut window);
    press(&mut window, Key::H);
    let before = settled(&mut window);
    waits_for(&mut window, &silent);

    let name = silent.folder.display().to_string();
    let is_said = |s: &Studio| told(s, NoticeKind::Warning, &[&name, "expected", "found", "check"]);
    let started = Instant::now();
    while !is_said(window.state()) {
        assert!(started.elapsed() < PATIENCE, "no warning names the drive");
        let pass = Instant::now();
        drag(&mut window, PointerButton::Primary);
        assert!(pass.elapsed() < 10 * PASS, "the window waits: {:?}", pass.elapsed());
    }
    assert!(window.state().n_drawn() > 100, "the picture stays");

    click(&mut window, "Cancel opening");
    wait(&mut window, "the scene again", is(RunState::Finished));
    assert!(told(window.state(), NoticeKind::Info, &[&name, "cancelled"]));
    let snapshot = window.state().snapshot();
    assert_eq!((snapshot.frames_done, snapshot.files.unsaved_frames), (3, 3), "nothing is lost");
    press(&mut window, Key::H);
    let after = settled(&mut window);
    let n_other = before.iter().zip(&after).filter(|(a, b)| a != b).count();
    assert!(n_other < before.len() / 2, "{n_other} of {} bytes: another picture", before.len());
    let file = folder.path().join("scene.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
}

#[test]
fn something_else_is_opened_while_a_drive_does_not_answer() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(silent) = Silent::new(folder.path()) else { return };
    let Some(mut window) = window(None, Painting::Auto) else { return };
    waits_for(&mut window, &silent);
    wait_for_label(&mut window, "Opening…");
    drop_on(&mut window, &path);
    wait(&mut window, "the dataset", is(RunState::Ready));
    train(&mut window);
    assert_eq!(window.state().snapshot().frames_done, 2);
    waits_for(&mut window, &silent);
    let started = Instant::now();
    drop(window);
    assert!(started.elapsed() < PASS, "closing waits for the drive: {:?}", started.elapsed());
}

#[test]
fn a_program_that_is_ended_keeps_its_training_and_waits_for_no_drive() {
    let folder = tempfile::tempdir().unwrap();
    let Some(silent) = Silent::new(folder.path()) else { return };
    let worker = Worker::start_with(Arc::new(|| {}), vec![folder.path().to_owned()]).unwrap();
    worker.send(WorkerOrder::Open(Subject::Path(dataset(folder.path(), 2))));
    worker.send(WorkerOrder::Step);
    until("a frame", || worker.snapshot().frames_done == 1);
    worker.send(WorkerOrder::Open(Subject::Path(silent.folder.clone())));
    until("the start of opening", || worker.snapshot().state == RunState::Loading);
    let started = Instant::now();
    let kept = worker.store();
    assert!(started.elapsed() < PASS, "{:?}", started.elapsed());
    assert!(format!("{kept}").contains("1"), "{kept}");
    assert!(worker.snapshot().is_terminated);
}

#[test]
fn a_frame_that_is_never_read_is_named_and_holds_up_nothing() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 30);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    wait(&mut window, "frame sampling", |s| s.snapshot().sampling.sample.is_some());
    // A frame far beyond the decoded ones, without a visible thumbnail.
    let file = "train/r_28_depth_0001.png";
    let Some(_silent) = Silent::of(folder.path(), path, file) else { return };
    window.key_press(Key::Space);
    let started = Instant::now();
    while window.query_by_label_contains("still reading after").is_none() {
        assert!(started.elapsed() < PATIENCE, "no label names the unread frame");
        let pass = Instant::now();
        window.step();
        assert!(pass.elapsed() < PASS, "the window waits: {:?}", pass.elapsed());
        std::thread::sleep(Duration::from_millis(10));
    }
    window.key_press(Key::Space);
    wait(&mut window, "the pause", is(RunState::Paused));
    let learnt = window.state().snapshot().frames_done;
    assert!(learnt > 0 && learnt < 30, "{learnt}");
    let file = folder.path().join("scene.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    // Requests one more frame, which cannot be read either.
    window.key_press(Key::Period);
    window.run_steps(3);
    let ended = Instant::now();
    drop(window);
    assert!(ended.elapsed() < PASS, "{:?}", ended.elapsed());
}

/// Querying a folder can block on its drive, so the worker does not query it before following. The poll on
/// another thread detects that the folder is missing.
#[test]
fn a_folder_that_is_gone_is_followed_all_the_same_until_it_is_back() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    train(&mut window);
    let elsewhere = folder.path().join("elsewhere");
    std::fs::rename(&path, &elsewhere).unwrap();
    live(&mut window);
    wait_for_label(&mut window, "Live: the recording cannot be read");
    let is_gone = |s: &Studio| {
        let snapshot = s.snapshot();
        let problem =
            snapshot.following.recording.as_ref().and_then(|followed| followed.problem.as_deref());
        problem.is_some_and(|problem| problem.contains("found nothing at this path"))
    };
    wait(&mut window, "the reason", is_gone);
    std::fs::rename(&elsewhere, &path).unwrap();
    wait_for_label(&mut window, "Live: waiting for the next frame");
}

#[test]
fn a_recording_that_falls_silent_is_named_and_what_was_learnt_is_saved() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    train(&mut window);
    live(&mut window);
    wait_for_label(&mut window, "following, 2 frames, waiting");
    let file = "transforms_train.json";
    let Some(_silent) = Silent::of(folder.path(), path.clone(), file) else { return };
    std::fs::write(path.join("more"), "").unwrap();
    let is_silent = |s: &Studio| {
        let snapshot = s.snapshot();
        let problem =
            snapshot.following.recording.as_ref().and_then(|followed| followed.problem.as_deref());
        problem.is_some_and(|problem| problem.contains("silent for 3 seconds; check"))
    };
    wait(&mut window, "the silence", is_silent);
    wait_for_label(&mut window, "Live: the recording cannot be read");
    window.key_press(Key::Space);
    wait(&mut window, "the pause", is(RunState::Paused));
    let file = folder.path().join("scene.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let ended = Instant::now();
    drop(window);
    assert!(ended.elapsed() < PASS, "{:?}", ended.elapsed());
}

/// A session samples some frames before it begins, also frames that were listed long before.
#[test]
fn a_recording_that_falls_silent_as_it_begins_is_named_and_holds_up_nothing() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (path, later) = (folder.path().join("room"), folder.path().join("later"));
    let params =
        SyntheticParams { width: 64, height: 48, n_train: 3, n_eval: 0, ..SyntheticParams::demo() };
    write(&params, &path, SyntheticLayout::SevenScenes, &mut |_, _| ()).unwrap();
    // The first frame is held out. The second contains only holes, so a session cannot start with it alone.
    let hole = "train/frame-000001.depth.png";
    std::fs::write(path.join(hole), image_of_holes(64, 48)).unwrap();
    std::fs::create_dir(&later).unwrap();
    let third = ["color.png", "depth.png", "pose.txt"].map(|end| format!("frame-000002.{end}"));
    let frames = path.join("train");
    third.iter().for_each(|name| std::fs::rename(frames.join(name), later.join(name)).unwrap());

    let Some(mut window) = window(None, Painting::Auto) else { return };
    live(&mut window);
    wait(&mut window, "the switch", |studio| studio.snapshot().following.is_on);
    let says = |part: &'static str| {
        move |studio: &Studio| {
            let snapshot = studio.snapshot();
            let problem = snapshot.following.recording.as_ref().and_then(|f| f.problem.as_deref());
            problem.is_some_and(|problem| problem.contains(part))
        }
    };
    drop_on(&mut window, &path);
    wait(&mut window, "a frame that shows nothing", says("only holes"));
    let Some(_silent) = Silent::of(folder.path(), path.clone(), hole) else { return };
    third.iter().for_each(|name| std::fs::rename(later.join(name), frames.join(name)).unwrap());
    wait(&mut window, "the silence", says("silent for 3 seconds; check"));
    assert_eq!(window.state().snapshot().state, RunState::Waiting);

    let asked = Instant::now();
    live(&mut window);
    wait(&mut window, "nothing", is(RunState::Empty));
    assert!(asked.elapsed() < PASS, "{:?}", asked.elapsed());
    live(&mut window);
    drop_on(&mut window, &path);
    wait(&mut window, "waiting", is(RunState::Waiting));
    wait(&mut window, "the silence again", says("silent for 3 seconds; check"));
    let ended = Instant::now();
    drop(window);
    assert!(ended.elapsed() < PASS, "{:?}", ended.elapsed());
}
