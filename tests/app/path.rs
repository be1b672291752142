//! The Path tab: keyframes from the view, playback, and a file for `render --path`.

use super::harness::{click, dataset, drag, is, train, wait, wait_for_label, window, write_to};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
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
    window.get_by_label_contains("and add keyframes");
    assert!(window.query_by_label("Play").is_none(), "nothing to play yet");
    let eye = |window: &super::harness::Window| {
        window.state().view().camera.keyframe().unwrap().pose.centre()
    };
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
        let now = s.view().camera.keyframe().map(|k| k.pose.centre());
        now.is_some_and(|now| now.distance(first) > 1e-6 && now.distance(second) > 1e-6)
    });
    window.get_by_label("Stop");
    wait(&mut window, "the end of the path", |s| {
        s.view().camera.keyframe().is_some_and(|k| k.pose.centre().distance(second) < 1e-9)
    });
    wait_for_label(&mut window, "Play");
    drag(&mut window, PointerButton::Primary);
    window.run_steps(2);
    assert!(eye(&window).distance(second) > 0.01, "a drag does not move the camera");
    click(&mut window, "Turntable");
    wait_for_label(&mut window, "360 pictures");
}

#[test]
fn a_film_is_drawn_as_the_command_line_draws_it_and_given_up_when_asked() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let subject = Some(Subject::Path(path));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    click(&mut window, "Path");
    click(&mut window, "Add keyframe");
    drag(&mut window, PointerButton::Primary);
    click(&mut window, "Add keyframe");
    click(&mut window, "Save path");
    let saved = folder.path().join("room.path.json");
    wait(&mut window, "the path", |_| saved.exists());

    let film = folder.path().join("film");
    let draw = |window: &mut super::harness::Window| {
        click(window, "Render film…");
        // The Path tab has a text field too, but the dialog's field has the focus.
        window.run_steps(2);
        window.key_press_modifiers(Modifiers::COMMAND, Key::A);
        window.event(Event::Text(film.display().to_string()));
        window.run_steps(2);
        window.get_by_role_and_label(Role::Button, "Render film").click();
        window.run_steps(2);
    };
    draw(&mut window);
    let has = |n: usize| film.join(format!("{n:05}.png")).exists();
    wait(&mut window, "pictures", |_| has(2));
    click(&mut window, "Cancel film");
    let is_told = |s: &vbgs_studio::app::Studio, word: &str| {
        s.snapshot().notices.iter().any(|n| n.kind == NoticeKind::Info && n.text.contains(word))
    };
    wait(&mut window, "the end", |s| is_told(s, "cancelled after"));
    assert!(!has(60), "the film was rendered to the end despite cancelling");

    // Rendering into the same folder again needs confirmation.
    draw(&mut window);
    wait_for_label(&mut window, "Replace the pictures in this folder?");
    click(&mut window, "Replace");
    wait(&mut window, "all pictures", |s| is_told(s, "Wrote 61 pictures"));
    assert!(has(60));

    // The command line renders the same picture from the saved path.
    click(&mut window, "Summary");
    let model = folder.path().join("scene.vbgs");
    write_to(&mut window, Key::S, "Save", &model);
    wait(&mut window, "the run", |s| s.snapshot().files.unsaved_frames == 0);
    let headless = folder.path().join("headless");
    let status = std::process::Command::new(env!("CARGO_BIN_EXE_vbgs-studio"))
        .args(["render", "--size", "1280x720", "--background", "#17191f", "--path"])
        .args([&saved, std::path::Path::new("-o"), &headless, &model])
        .status();
    assert!(status.unwrap().success());
    let [own, other] =
        [&film, &headless].map(|folder| image::open(folder.join("00030.png")).unwrap());
    let [own, other] = [own.to_rgb8(), other.to_rgb8()];
    let apart = own.iter().zip(other.iter()).filter(|(a, b)| a.abs_diff(**b) > 2).count();
    assert!(apart * 100 < own.len(), "{apart} of {} values differ", own.len());
}
