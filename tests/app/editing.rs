//! Selecting, hiding, deleting and cropping splats, and showing the scene of earlier frames.

use super::harness::{
    Window, click, dataset, drag_between, is, settled, step, train, wait, wait_for_picture, window,
    write_to,
};
use super::viewer::{choose, press};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Key, Modifiers, PointerButton, Pos2, Rect, pos2};
use egui_kittest::kittest::Queryable;
use std::path::Path;
use vbgs_studio::app::Painting;
use vbgs_studio::app::color_mode::ColorMode;
use vbgs_studio::app::edit::marks::{Edits, Mark};
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::export;

const BOTH: [Painting; 2] = [Painting::Auto, Painting::Gpu];
/// Corners of a selection box that covers only part of the scene.
const BOX: [Pos2; 2] = [pos2(220.0, 250.0), pos2(420.0, 450.0)];

fn trained(room: &Path, painting: Painting) -> Option<Window> {
    let mut window = window(Some(Subject::Path(room.to_owned())), painting)?;
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    wait_for_picture(&mut window);
    Some(window)
}

fn edits(window: &Window) -> Edits {
    window.state().view().editor().edits().clone()
}

/// Selects the splats in [`BOX`], then returns to orbiting by drags.
fn select_box(window: &mut Window) {
    press(window, Key::B);
    drag_between(window, PointerButton::Primary, BOX[0], BOX[1]);
    press(window, Key::B);
    assert!(edits(window).count(Mark::Selected) > 0, "the box holds no splat");
}

/// Number of pixels in the selection colour.
fn n_marked(window: &mut Window) -> usize {
    let image = window.render().unwrap();
    let pixels = (150..500).flat_map(|y| (50..550).map(move |x| (x, y)));
    let is_marked = |[r, g, b, _]: [u8; 4]| r > 220 && g < 130 && (180..240).contains(&b);
    pixels.filter(|&(x, y)| is_marked(image.get_pixel(x, y).0)).count()
}

fn wait_for_marks(window: &mut Window, what: &str, is_right: impl Fn(usize) -> bool) {
    let begun = std::time::Instant::now();
    loop {
        let n = n_marked(window);
        if is_right(n) {
            return;
        }
        assert!(begun.elapsed() < super::harness::PATIENCE, "{what}: {n} marked pixels");
        window.step();
    }
}

#[test]
fn what_a_box_selects_is_seen_in_every_colour_and_is_hidden_and_comes_back() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 3);
    for painting in BOTH {
        let Some(mut window) = trained(&room, painting) else { return };
        assert_eq!(n_marked(&mut window), 0);
        let eye = window.state().view().camera.eye();
        select_box(&mut window);
        assert_eq!(window.state().view().camera.eye(), eye, "the drag does not turn the camera");
        for mode in ColorMode::ALL.into_iter().rev() {
            choose(&mut window, 1, mode.label());
            wait_for_marks(&mut window, mode.label(), |n| n > 500);
        }
        let (all, selected) = (window.state().n_drawn(), edits(&window).count(Mark::Selected));
        press(&mut window, Key::K);
        wait(&mut window, "hidden", move |s| s.n_drawn() == all - selected);
        wait_for_marks(&mut window, "hidden", |n| n == 0);
        press(&mut window, Key::U);
        wait(&mut window, "shown again", move |s| s.n_drawn() == all);
        for _ in 0..2 {
            window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
            window.run_steps(2);
        }
        wait_for_marks(&mut window, "selected again", |n| n > 500);
        window.key_press_modifiers(Modifiers::COMMAND | Modifiers::SHIFT, Key::Z);
        wait(&mut window, "hidden again", move |s| s.n_drawn() == all - selected);
    }
}

/// Exports to a file; returns its number of splats and the text of the notice.
fn exported(window: &mut Window, file: &Path) -> (usize, String) {
    let before = window.state().snapshot().files.latest_write;
    write_to(window, Key::E, "Export", file);
    wait(window, "the file", move |s| {
        let latest = s.snapshot().files.latest_write;
        latest != before && latest.is_some_and(|write| write.is_written)
    });
    let words = window.state().snapshot().notices.last().unwrap().text.clone();
    (export::read(file).unwrap().splats.len(), words)
}

#[test]
fn exports_lack_what_was_deleted_or_cropped_and_the_model_keeps_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 3);
    let Some(mut window) = trained(&room, Painting::Auto) else { return };
    let file = |name: &str| folder.path().join(format!("{name}.ply"));
    let (used, drawn) = (window.state().snapshot().model.used, window.state().n_drawn());
    let (all, words) = exported(&mut window, &file("all"));
    assert!(!words.contains("left out"), "{words}");
    select_box(&mut window);
    let n = edits(&window).count(Mark::Selected);
    press(&mut window, Key::Delete);
    let (without, words) = exported(&mut window, &file("without"));
    assert!(without < all, "{without} of {all}");
    assert!(words.contains(&format!("{n} splats were left out")), "{words}");
    assert_eq!(window.state().snapshot().model.used, used, "the model keeps all splats");
    click(&mut window, "Edit");
    window.get_by_label_contains("An export writes");
    // Undo restores the selection, which defines the crop box.
    window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, "Crop box").click_accesskit();
    window.run_steps(2);
    let [low, high] = edits(&window).crop().unwrap();
    assert!(low.cmplt(high).all());
    wait(&mut window, "the crop", move |s| s.n_drawn() < drawn);
    let (cropped, words) = exported(&mut window, &file("cropped"));
    assert!(cropped < all && words.contains("left out"), "{cropped}: {words}");
    while window.state().view().editor().log.can_undo() {
        window.key_press_modifiers(Modifiers::COMMAND, Key::Z);
        window.run_steps(2);
    }
    assert_eq!(exported(&mut window, &file("again")).0, all, "undo restores every splat");
}

/// Returns the slider of the open panel.
fn slider(window: &mut Window) -> Rect {
    window.run_steps(2);
    let mut sliders = window.query_all_by_role(Role::Slider).map(|slider| slider.rect());
    // Excludes the detail slider in the toolbar above.
    sliders.find(|rect| rect.top() > 100.0).unwrap()
}

#[test]
fn training_goes_on_beside_edits_and_what_it_bears_is_shown() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 4));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    step(&mut window);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done == 1 && s.n_drawn() > 100);
    settled(&mut window);
    select_box(&mut window);
    let deleted = edits(&window).count(Mark::Selected);
    press(&mut window, Key::Delete);
    let before = window.state().n_drawn();
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    wait(&mut window, "more splats", move |s| s.n_drawn() > before);
    settled(&mut window);
    let left = window.state().n_drawn();
    for (key, n) in [(Key::Z, left + deleted), (Key::Y, left)] {
        window.key_press_modifiers(Modifiers::COMMAND, key);
        wait(&mut window, "the deleted, back and away", move |s| s.n_drawn() == n);
    }
}

/// The view of an earlier frame equals the picture shown then, even while training continues.
#[test]
fn a_walk_back_shows_the_scene_as_it_was_and_training_goes_on_behind_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let room = dataset(folder.path(), 6);
    let Some(mut window) = window(Some(Subject::Path(room)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    press(&mut window, Key::T);
    step_to(&mut window, 1);
    // Moves the camera, which then no longer follows training.
    drag_between(&mut window, PointerButton::Primary, BOX[0], BOX[1]);
    assert!(!window.state().view().camera.is_guided());
    click(&mut window, "Edit");
    let first = settled(&mut window);
    let (splats, drawn) = (window.state().view().learned().clone(), window.state().n_drawn());
    for frame in 2..=3 {
        step_to(&mut window, frame);
    }
    wait(&mut window, "more splats", move |s| s.n_drawn() > drawn);
    assert!(settled(&mut window) != first, "the scene has grown");
    let at = slider(&mut window);
    drag_between(&mut window, PointerButton::Primary, at.right_center(), at.left_center());
    wait(&mut window, "the past", move |s| s.n_drawn() == drawn);
    window.get_by_label("Scene after frame 1 of 6 (Edit)");
    let past = window.state().view().editor().displayed_past().unwrap().clone();
    assert!(past.after.n_seen == 1 && *past.splats().unwrap() == *splats, "other splats");
    assert!(settled(&mut window) == first, "the picture differs from the one shown after frame 1");
    step_to(&mut window, 4);
    assert!(settled(&mut window) == first, "what is trained is not shown");
    window.get_by_label("Newest").click_accesskit();
    wait(&mut window, "the scene of now", move |s| s.n_drawn() > drawn);
    let at = slider(&mut window);
    drag_between(&mut window, PointerButton::Primary, at.right_center(), at.left_center());
    wait(&mut window, "the past again", move |s| s.n_drawn() == drawn);
    press(&mut window, Key::B);
    let editor = window.state().view().editor();
    assert!(
        editor.is_box_selecting && editor.displayed_past().is_none(),
        "selecting must return to the current scene"
    );
    assert_eq!(window.state().view().editor().stored_scenes.moments().len(), 4);
}

fn step_to(window: &mut Window, frame: usize) {
    step(window);
    wait(window, "a frame", move |s| s.snapshot().frames_done == frame);
    wait(window, "its splats", |s| s.n_drawn() > 100);
}
