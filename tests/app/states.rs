//! Every state of a run, as shown in the window.

use super::harness::{PATIENCE, click, dataset, is, reset, step, wait, wait_for_label, window};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Vec2};
use egui_kittest::kittest::Queryable;
use std::time::Instant;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Source, Subject};
use vbgs_studio::app::wording;

#[test]
fn a_dataset_goes_through_every_state() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    assert_eq!(window.state().snapshot().source, Source::Dataset);

    step(&mut window);
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    assert_eq!(window.state().snapshot().state, RunState::Paused);
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    assert_eq!(window.state().snapshot().frames_done, 4);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);

    // Discarding unsaved training needs confirmation.
    reset(&mut window);
    window.get_by_label_contains("Discard “");
    click(&mut window, "Cancel");
    assert_eq!(window.state().snapshot().frames_done, 4);
    reset(&mut window);
    click(&mut window, "Discard");
    wait(&mut window, "ready again", is(RunState::Ready));
    assert_eq!(window.state().snapshot().frames_done, 0);
}

#[test]
fn help_lists_every_shortcut_and_tabs_switch() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.key_press(Key::F1);
    window.run_steps(2);
    window.get_by_label("Left drag");
    window.get_by_label("Train on exactly one frame");
    for (key, size) in [(Key::F1, Vec2::new(800.0, 600.0)), (Key::Escape, Vec2::new(640.0, 400.0))]
    {
        window.set_size(size);
        window.run_steps(4);
        let list = window.get_by_role_and_label(Role::Window, "Shortcuts").rect();
        assert!(list.height() < size.y && list.bottom() <= size.y, "{list} in {size}");
        window.key_press(key);
        window.run_steps(2);
        assert!(window.query_by_label("Left drag").is_none(), "{key:?} closes it");
        window.key_press(Key::F1);
        window.run_steps(2);
    }
    window.key_press(Key::F1);
    window.run_steps(2);
    click(&mut window, "Summary");
    window.get_by_label("Nothing is open.");
    window.set_size(Vec2::new(640.0, 400.0));
    window.run_steps(2);
    window.render().unwrap();
}

#[test]
fn the_status_line_tells_state_pace_components_and_memory() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    // Enough frames for several snapshots during training.
    let subject = Subject::Path(super::waiting::large(folder.path(), 60));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    wait_for_label(&mut window, "Ready");
    window.key_press(Key::Space);
    let started = Instant::now();
    // Checks the drawn label, since the latest snapshot may be newer than the last pass.
    while window.query_by_label_contains("frames/s").is_none() {
        let snapshot = window.state().snapshot();
        let (state, frames) = (snapshot.state, snapshot.frames_done);
        assert!(started.elapsed() < PATIENCE, "no pace is shown: {state:?} after {frames} frames");
        window.step();
    }
    window.get_by_label("Training");
    wait(&mut window, "the end", is(RunState::Finished));
    window.run_steps(2);
    let used = window.state().snapshot().model.used;
    window.get_by_label("Finished");
    window.get_by_label(&wording::count(used, "splat"));
    for unit in ["ms a frame", "MB of memory"] {
        assert!(window.query_all_by_label_contains(unit).count() > 0, "{unit}");
    }
}
