//! The Path tab: keyframes from the view, a preview that moves the camera, and a file for `render --path`.

use super::harness::{click, dataset, drag, is, train, wait, wait_for_label, window};
use crate::common::adapter::turn;
use eframe::egui::PointerButton;
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::export::camera_path::PacedPath;

#[test]
fn a_path_is_made_played_saved_and_opened_again() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "the end", is(RunState::Finished));
    click(&mut window, "Path");
    window.get_by_label_contains("then add keyframes");
    assert!(window.query_by_label("Play").is_none(), "nothing to play yet");
    let eye =
        |window: &super::harness::Window| window.state().view().keyframe().unwrap().pose.centre();
    window.run_steps(2);
    let first = eye(&window);
    click(&mut window, "Add keyframe");
    drag(&mut window, PointerButton::Primary);
    window.run_steps(2);
    let second = eye(&window);
    assert!(first.distance(second) > 0.01);
    click(&mut window, "Add keyframe");
    wait_for_label(&mut window, "61 pictures");

    click(&mut window, "Save path");
    let file = folder.path().join(format!("{}.path.json", path.file_name().unwrap().display()));
    wait(&mut window, "the file", |_| file.exists());
    let saved = PacedPath::read(&file, DVec3::Z).unwrap();
    let places: Vec<DVec3> = saved.path.keyframes().iter().map(|k| k.pose.centre()).collect();
    assert!(places[0].distance(first) < 1e-9 && places[1].distance(second) < 1e-9, "{places:?}");

    click(&mut window, "Play");
    wait(&mut window, "the camera on its way", |s| {
        let now = s.view().keyframe().map(|k| k.pose.centre());
        now.is_some_and(|now| now.distance(first) > 1e-6 && now.distance(second) > 1e-6)
    });
    window.get_by_label("Stop");
    wait(&mut window, "the end of the path", |s| {
        s.view().keyframe().is_some_and(|k| k.pose.centre().distance(second) < 1e-9)
    });
    wait_for_label(&mut window, "Play");
    drag(&mut window, PointerButton::Primary);
    window.run_steps(2);
    assert!(eye(&window).distance(second) > 0.01, "a hand takes over where it stood");
    click(&mut window, "Turntable");
    wait_for_label(&mut window, "360 pictures");
}
