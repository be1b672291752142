//! First use: the start page, an opened dataset, and a camera that follows training.

use super::harness::{
    PATIENCE, Window, click, dataset, drag, drop_on, is, wait, wait_for_picture, window,
};
use crate::common::adapter::turn;
use eframe::egui::{Id, Key, PointerButton, Vec2};
use egui_kittest::kittest::Queryable;
use std::time::Instant;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};

#[test]
fn the_start_page_says_what_happens_and_how_to_begin() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(2);
    window.get_by_label("Your own capture: drop a folder");
    window.get_by_label_contains("into a Gaussian-splat scene while you watch");
    click(&mut window, "Try the synthetic scene");
    wait(&mut window, "training", is(RunState::Training));
}

#[test]
fn an_opened_dataset_is_never_blank_and_one_button_trains_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    window.run_steps(2);
    window.get_by_label_contains("Recognised as");
    window.get_by_label("train: 3 frames of 64×48, all for training");
    // Before training the viewport shows the cameras and their photographs.
    wait_for_picture(&mut window);
    // Its result adds lines to the card, which move the button.
    wait(&mut window, "the check of poses", |s| s.snapshot().sampling.poses.is_some());
    click(&mut window, "Train 3 frames");
    wait(&mut window, "the end", is(RunState::Finished));
    assert!(window.query_by_label_contains("Recognised as").is_none(), "the card is gone");
}

/// Steps until the camera follows training, or no longer does.
fn wait_for_guide(window: &mut Window, is_guided: bool) {
    let started = Instant::now();
    while window.state().view().camera.is_guided() != is_guided {
        assert!(started.elapsed() < PATIENCE);
        window.step();
    }
}

#[test]
fn the_camera_rides_along_until_it_is_moved() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    assert!(window.state().view().camera.is_guided());
    click(&mut window, "Step");
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    window.run_steps(2);
    // The camera is at the pose of the first frame.
    let opened = window.state().snapshot().opened.clone().unwrap();
    let split = opened.plan.as_ref().unwrap().split;
    let taken = opened.dataset.as_ref().unwrap().splits[split].frames[0].camera.pose;
    let stands = window.state().view().camera.eye().unwrap();
    assert!((stands - taken.centre()).length() < 1e-6, "{stands}");
    drag(&mut window, PointerButton::Primary);
    wait_for_guide(&mut window, false);
    let left = window.state().view().camera.eye();
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    window.run_steps(3);
    assert_eq!(window.state().view().camera.eye(), left, "training moves the user's view");
    window.key_press(Key::V);
    wait_for_guide(&mut window, true);
    window.run_steps(2);
    assert_ne!(window.state().view().camera.eye(), left);
}

/// Asserts that the card lies below all notices and contains its button.
fn assert_card_below_notices(window: &mut Window, card: &'static str, button: &str) {
    for size in [Vec2::new(800.0, 600.0), Vec2::new(1600.0, 1000.0)] {
        window.set_size(size);
        window.run_steps(6);
        let [card, notices] = [card, "notices"]
            .map(|name| window.ctx.memory(|memory| memory.area_rect(Id::unique(name))).unwrap());
        assert!(notices.height() > 50.0, "{notices} in {size}");
        assert!(card.height() > 80.0, "{card} in {size}");
        assert!(notices.bottom() <= card.top(), "{notices} and {card} in {size}");
        let button = window.get_by_label(button).rect();
        assert!(card.contains_rect(button), "{button} on {card} in {size}");
    }
}

#[test]
fn cards_leave_notices_their_place_in_small_windows() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    for missing in ["a", "b", "c"] {
        let before = window.state().snapshot().notices.len();
        drop_on(&mut window, &folder.path().join(missing));
        wait(&mut window, "the notice", |s| s.snapshot().notices.len() > before);
    }
    assert_card_below_notices(&mut window, "ready", "Train 3 frames");
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    assert_card_below_notices(&mut window, "summary", "Compare with photographs");
}
