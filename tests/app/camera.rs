//! Steering the camera.

use super::harness::{Window, click, dataset, drag, settled, train, turn_wheel, wait, window};
use super::inspect::MIDDLE;
use crate::common::adapter::turn;
use eframe::egui::{Key, PointerButton};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::Subject;

#[test]
fn the_camera_follows_the_pointer_and_keys() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    click(&mut window, "×");
    window.key_press(Key::H);
    window.step();
    let home = settled(&mut window);
    drag(&mut window, PointerButton::Primary);
    let turned = settled(&mut window);
    assert_ne!(home, turned, "orbit");
    drag(&mut window, PointerButton::Secondary);
    let panned = settled(&mut window);
    assert_ne!(turned, panned, "pan");
    drag(&mut window, PointerButton::Middle);
    assert_ne!(panned, settled(&mut window), "pan by the middle button");
    let distance = |window: &Window| {
        let view = window.state().view();
        view.eye().unwrap().distance(view.target().unwrap())
    };
    let before = distance(&window);
    turn_wheel(&mut window, MIDDLE, 100.0);
    let near = distance(&window);
    assert!(near < 0.9 * before, "{before} → {near}");
    turn_wheel(&mut window, MIDDLE, -300.0);
    assert!(distance(&window) > 1.2 * before, "{before} → {}", distance(&window));
    window.key_press(Key::F);
    window.step();
    assert_ne!(panned, settled(&mut window), "frame");
    window.key_press(Key::H);
    window.step();
    assert_eq!(home, settled(&mut window), "home");
}
