//! The Path tab: keyframes from the view, playback, and a file for `render --path`.

use super::harness::{
    click, dataset, drag, is, train, turn_wheel, wait, wait_for_label, window, write_to,
};
use super::inspect::MIDDLE;
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::export::camera_path::PacedPath;
use vbgs_studio::model::splat::framing::framing;

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

    // The orbit is closed, starts here and circles the middle of the scene, not what the camera looks at.
    let (start, scene) = {
        let view = window.state().view();
        (view.camera.keyframe().unwrap().pose.centre(), framing(view.learned().iter()).unwrap())
    };
    click(&mut window, "Save path");
    let file = folder.path().join("room.path-2.json");
    wait(&mut window, "the orbit", |_| file.exists());
    let orbit = PacedPath::read(&file, DVec3::Z).unwrap();
    let keyframes = orbit.path.keyframes();
    assert!(orbit.path.is_loop() && keyframes[0].pose.centre().distance(start) < 1e-6);
    let distance = start.distance(scene.centre);
    for keyframe in keyframes {
        let ray = scene.centre - keyframe.pose.centre();
        assert!((ray.length() - distance).abs() < 1e-6, "{} of {distance}", ray.length());
        assert!(ray.normalize().dot(keyframe.pose.forward()) > 1.0 - 1e-9);
    }
}

/// Number of pixels of the viewport in the colour of the camera path.
fn path_pixels(window: &mut super::harness::Window) -> usize {
    window.run_steps(2);
    let image = window.render().unwrap();
    let is_of_path = |pixel: &[u8; 4]| {
        [235u8, 110, 235].iter().zip(pixel).all(|(own, found)| own.abs_diff(*found) < 12)
    };
    image.pixels().filter(|pixel| is_of_path(&pixel.0)).count()
}

#[test]
fn the_edited_path_is_drawn_in_the_view_while_its_tab_is_open() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    click(&mut window, "Path");
    click(&mut window, "Add keyframe");
    drag(&mut window, PointerButton::Primary);
    click(&mut window, "Add keyframe");
    // From farther away both keyframes are in the view.
    turn_wheel(&mut window, MIDDLE, -400.0);
    let drawn = path_pixels(&mut window);
    assert!(drawn > 60, "{drawn} pixels");
    click(&mut window, "Play");
    window.get_by_label("Stop");
    assert_eq!(path_pixels(&mut window), 0, "a film has no drawings");
    click(&mut window, "Stop");
    click(&mut window, "Summary");
    assert_eq!(path_pixels(&mut window), 0, "another tab");
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
    let render_film = |window: &mut super::harness::Window, output: &std::path::Path| {
        click(window, "Render film…");
        // The Path tab has a text field too, but the dialog's field has the focus.
        window.run_steps(2);
        window.key_press_modifiers(Modifiers::COMMAND, Key::A);
        window.event(Event::Text(output.display().to_string()));
        window.run_steps(2);
        window.get_by_role_and_label(Role::Button, "Render film").click();
        window.run_steps(2);
    };
    render_film(&mut window, &film);
    let has = |n: usize| film.join(format!("{n:05}.png")).exists();
    wait(&mut window, "pictures", |_| has(2));
    click(&mut window, "Cancel film");
    let is_told = |s: &vbgs_studio::app::Studio, word: &str| {
        s.snapshot().notices.iter().any(|n| n.kind == NoticeKind::Info && n.text.contains(word))
    };
    wait(&mut window, "the end", |s| is_told(s, "cancelled after"));
    assert!(!has(60), "the film was rendered to the end despite cancelling");

    // Rendering into the same folder again needs confirmation.
    render_film(&mut window, &film);
    wait_for_label(&mut window, "Replace the pictures in this folder?");
    click(&mut window, "Replace");
    wait(&mut window, "all pictures", |s| is_told(s, "Wrote 61 pictures"));
    assert!(has(60));

    // A GIF needs no other program; one that is cancelled leaves nothing.
    let files = || std::fs::read_dir(folder.path()).unwrap().count();
    let before = files();
    render_film(&mut window, &folder.path().join("film.gif"));
    wait(&mut window, "the growing GIF", |_| files() == before + 1);
    click(&mut window, "Cancel film");
    wait(&mut window, "the end", |s| is_told(s, "film.gif: cancelled after"));
    assert_eq!(files(), before);

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
