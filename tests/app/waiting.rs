//! Nothing blocks: the window waits neither for the trainer nor for files, the trainer not for the window.

use super::harness::{
    PATIENCE, Window, dataset, drag, drag_between, drop_on, is, settled, train, wait,
    wait_for_picture, window,
};
use super::inspect::MIDDLE;
use super::viewer::press;
use crate::common::adapter::turn;
use eframe::egui::{Key, PointerButton, Vec2};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::edit::marks::Mark;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};

/// Writes a dataset whose frames take noticeable time to train.
pub fn large(folder: &Path, n_train: usize) -> PathBuf {
    let path = folder.join("large");
    let params = SyntheticParams {
        width: 320,
        height: 240,
        n_train,
        n_eval: 1,
        seed: 1,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, SyntheticLayout::Blender(DepthBits::Sixteen), &mut |_, _| {}).unwrap();
    path
}

/// Writes a dataset that takes a while to open: `n_frames` entries of the same frame.
fn long(folder: &Path, n_frames: usize) -> PathBuf {
    let path = dataset(folder, 2);
    for name in ["transforms_train.json", "transforms_test.json"] {
        let file = path.join(name);
        let Ok(text) = std::fs::read_to_string(&file) else { continue };
        let mut all: serde_json::Value = serde_json::from_str(&text).unwrap();
        let frames = all["frames"].as_array_mut().unwrap();
        let first = frames[0].clone();
        frames.resize(n_frames, first);
        std::fs::write(&file, all.to_string()).unwrap();
    }
    path
}

#[test]
fn the_window_is_drawn_and_steered_while_a_frame_is_trained() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(large(folder.path(), 6));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    window.key_press(Key::Space);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done > 0);
    let (mut n_passes, mut most) = (0, 0);
    let mut before = window.state().snapshot().frames_done;
    while window.state().snapshot().state == RunState::Training {
        window.step();
        n_passes += 1;
        let done = window.state().snapshot().frames_done;
        if done != before {
            (before, most, n_passes) = (done, most.max(n_passes), 0);
        }
    }
    assert_eq!(window.state().snapshot().frames_done, 6);
    // A window that waited for frames would have one pass per frame.
    assert!(most >= 3, "only {most} passes within one frame");
    super::harness::drag(&mut window, PointerButton::Primary);
}

#[test]
fn frames_are_trained_while_the_window_does_nothing() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 12));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    window.key_press(Key::Space);
    window.run_steps(2);
    // The window runs no further passes: undrawn updates must not block the trainer.
    let started = Instant::now();
    while window.state().snapshot().state != RunState::Finished {
        assert!(started.elapsed() < PATIENCE, "the trainer waits for the window");
        std::thread::sleep(Duration::from_millis(10));
    }
    assert_eq!(window.state().snapshot().frames_done, 12);
    wait(&mut window, "all that was missed", |s| s.n_drawn() > 100);
}

#[test]
fn the_last_picture_stays_while_something_is_opened() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| folder.path().join(name));
    for folder in [&a, &b] {
        std::fs::create_dir(folder).unwrap();
    }
    let (shown, next) = (dataset(&a, 2), long(&b, 20_000));
    let Some(mut window) = window(Some(Subject::Demo), Painting::Auto) else { return };
    // The demo is replaced without a question.
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    window.key_press(Key::Space);
    wait(&mut window, "pause", is(RunState::Paused));
    wait_for_picture(&mut window);
    drop_on(&mut window, &next);
    let started = Instant::now();
    while window.state().snapshot().state != RunState::Loading {
        assert!(started.elapsed() < PATIENCE, "it is never opened");
        std::thread::sleep(Duration::from_millis(1));
    }
    let drawn = window.state().n_drawn();
    window.step();
    // The pass ended before the dataset was open, so the window did not wait for it.
    assert_eq!(window.state().snapshot().state, RunState::Loading);
    assert!(drawn > 100 && window.state().n_drawn() == drawn, "the scene stays");
    wait_for_picture(&mut window);
    wait(&mut window, "the next", |s| s.snapshot().state == RunState::Ready);
    drop_on(&mut window, &shown);
    // The previous dataset is Ready too, so wait for the new one's number of frames.
    wait(&mut window, "the shown one", |s| s.snapshot().n_frames == 2);
    train(&mut window);
}

/// Splats are uploaded to the GPU once: a moving camera uploads none, a change uploads only changed splats.
#[test]
fn only_splats_that_changed_are_uploaded() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Some(Subject::Path(dataset(folder.path(), 3)));
    let Some(mut window) = window(subject, Painting::Gpu) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    settled(&mut window);
    let all = uploaded(&window, usize::MAX);
    assert!(all > 0, "the scene was uploaded");
    drag(&mut window, PointerButton::Primary);
    assert_eq!(uploaded(&window, 5), 0, "a moving camera uploads splats");
    press(&mut window, Key::B);
    let corners = [-60.0, 60.0].map(|side| MIDDLE + Vec2::splat(side));
    drag_between(&mut window, PointerButton::Primary, corners[0], corners[1]);
    settled(&mut window);
    let n_selected = window.state().view().editor().edits().count(Mark::Selected);
    let n_all = window.state().view().learned().len();
    assert!(0 < n_selected && 4 * n_selected < n_all, "{n_selected} of {n_all}");
    // Only the latest pictures count, since selecting uploads the shown set once.
    press(&mut window, Key::K);
    settled(&mut window);
    let hidden = uploaded(&window, 3);
    assert!(hidden < all / 2, "{hidden} of {all} bytes for {n_selected} of {n_all} splats");
}

/// Bytes of splats uploaded to the GPU for the latest `n_pictures`.
fn uploaded(window: &Window, n_pictures: usize) -> u64 {
    let bytes = window.state().view().painter.drawn.samples().map(|sample| sample.uploaded_bytes);
    let bytes: Vec<u64> = bytes.collect();
    bytes.iter().rev().take(n_pictures).sum()
}
