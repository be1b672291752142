//! First use: the start page, an opened dataset, and a camera that follows training.

use super::harness::{
    PATIENCE, Window, click, dataset, drag, drop_on, is, step, train, wait, wait_for_picture,
    window,
};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Id, Key, PointerButton, Rect, Vec2};
use egui_kittest::kittest::{AccessKitNode, NodeT, Queryable};
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
    assert!(window.query_all_by_label_contains("NeRF-synthetic").count() > 0);
    window.get_by_label("Training: 3 frames, 64×48");
    // Before training the viewport shows the cameras and their photographs.
    wait_for_picture(&mut window);
    // Its result adds lines to the panel, which move the button.
    wait(&mut window, "the check of poses", |s| s.snapshot().sampling.poses.is_some());
    click(&mut window, "Train 3 frames");
    wait(&mut window, "the end", is(RunState::Finished));
    assert!(window.query_by_label("Train 3 frames").is_none(), "the button is gone");
    window.get_by_label_contains("Done: 3 frames in ");
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
    step(&mut window);
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

/// Returns the rectangle of the notices.
fn notices(window: &Window) -> Rect {
    window.ctx.memory(|memory| memory.area_rect(Id::unique("notices"))).unwrap()
}

#[test]
fn notices_are_single_lines_below_the_captions_and_close_together() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path.clone())), Painting::Auto) else {
        return;
    };
    wait(&mut window, "ready", is(RunState::Ready));
    for missing in ["a", "b", "c", "d"] {
        let before = window.state().snapshot().notices.len();
        drop_on(&mut window, &folder.path().join(missing));
        wait(&mut window, "the notice", |s| s.snapshot().notices.len() > before);
    }
    for size in [Vec2::new(640.0, 400.0), Vec2::new(800.0, 600.0), Vec2::new(1600.0, 1000.0)] {
        window.set_size(size);
        window.run_steps(6);
        // Three of them, although there are four.
        let [first, second, third] = [0, 1, 2].map(|i| {
            let all: Vec<_> = window.query_all_by_label("×").map(|node| node.rect()).collect();
            assert_eq!(all.len(), 3);
            all[i].center().y
        });
        assert!(second - first < 30.0 && (third - second - (second - first)).abs() < 1.0, "{size}");
        assert!(notices(&window).height() < 140.0, "{} in {size}", notices(&window));
        assert!(first > notices(&window).top());
    }
    // The whole text on a click.
    let line = notices(&window).height();
    window.get_all_by_label_contains("d: ").next().unwrap().click();
    window.run_steps(4);
    assert!(notices(&window).height() >= line);
    click(&mut window, "Close all");
    window.run_steps(3);
    assert!(window.query_by_label("×").is_none());

    // What opens clears the failures before it.
    drop_on(&mut window, &folder.path().join("e"));
    wait(&mut window, "the notice", |s| {
        s.snapshot().notices.iter().any(|n| n.text.contains("/e:"))
    });
    drop_on(&mut window, &path);
    wait(&mut window, "another opening", |s| {
        is(RunState::Ready)(s) && s.snapshot().notices.iter().all(|n| !n.text.contains("/e:"))
    });
}

/// True for what a user can press or change, apart from the strip's frames.
fn is_control(node: &AccessKitNode<'_>) -> bool {
    let (role, label) = (node.role(), node.label().unwrap_or_default());
    let is_frame = label.strip_prefix("Frame ").is_some_and(|n| n.parse::<usize>().is_ok());
    let roles =
        [Role::Button, Role::CheckBox, Role::ComboBox, Role::Link, Role::Slider, Role::SpinButton];
    roles.contains(&role) && !is_frame
}

#[test]
fn few_controls_are_visible_and_none_wraps() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    for width in [1024.0, 1280.0] {
        window.set_size(Vec2::new(width, 800.0));
        if width == 1024.0 {
            train(&mut window);
            wait(&mut window, "figures", |s| s.quality().result().is_some());
        }
        window.run_steps(4);
        let controls: Vec<_> = window
            .query_all_by(is_control)
            .map(|node| (node.accesskit_node().label().unwrap_or_default(), node.rect()))
            .collect();
        assert!(controls.len() <= 26, "{}: {controls:?}", controls.len());
        assert!(controls.iter().any(|(label, _)| label == "Walk back"), "{controls:?}");
        // Icons are pictures beside the names, not parts of them.
        let is_plain = |label: &str| label.chars().all(|letter| letter < '\u{F0000}');
        assert!(controls.iter().all(|(label, _)| is_plain(label)), "{controls:?}");
        // The top bar is one row, and so is the toolbar below it.
        let top = window.get_by_label("Open").rect();
        let toolbar = window.get_by_label("Show").rect();
        let rows = |y: f32| controls.iter().filter(move |(_, rect)| rect.y_range().contains(y));
        let above: Vec<_> =
            controls.iter().filter(|(_, rect)| rect.bottom() < toolbar.top()).collect();
        assert!(above.iter().all(|(_, rect)| rect.y_range().contains(top.center().y)), "{above:?}");
        let over_picture = rows(toolbar.center().y).filter(|(_, rect)| rect.left() < width - 380.0);
        assert!(over_picture.count() <= 11);
    }
}
