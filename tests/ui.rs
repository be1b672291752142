//! The real window, driven without a display: every state, every button, both painters.
#![cfg(feature = "gui")]
#![allow(clippy::unwrap_used)]

mod common;

use common::adapter::{turn, vulkan};
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use vbgs_studio::app::state::{NoticeKind, RunState, Source, Subject};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{DepthBits, SyntheticLayout, write};
use vbgs_studio::export;

type Window = Harness<'static, Studio>;

/// Longest any condition may take on a loaded machine.
const PATIENCE: Duration = Duration::from_secs(120);

/// The window, or `None` without a Vulkan adapter, which in CI is a failure.
fn window(subject: Option<Subject>, painting: Painting) -> Option<Window> {
    vulkan()?;
    let harness = Harness::builder()
        .with_size(Vec2::new(1000.0, 640.0))
        .with_max_steps(8)
        .wgpu()
        .build_eframe(move |cc| Studio::new(cc, subject, painting, Instant::now()).unwrap());
    Some(harness)
}

/// Steps the window until the condition holds.
fn wait(window: &mut Window, what: &str, condition: impl Fn(&Studio) -> bool) {
    let started = Instant::now();
    loop {
        window.step();
        if condition(window.state()) {
            return;
        }
        let snapshot = window.state().snapshot();
        let notices: Vec<&str> = snapshot.notices.iter().map(|n| n.text.as_str()).collect();
        assert!(
            started.elapsed() < PATIENCE,
            "waited for {what}, still {:?}; {notices:?}",
            snapshot.state
        );
        std::thread::sleep(Duration::from_millis(10));
    }
}

fn is(state: RunState) -> impl Fn(&Studio) -> bool {
    move |studio| studio.snapshot().state == state
}

/// Trains what is open to the end.
fn train(window: &mut Window) {
    wait(window, "ready", is(RunState::Ready));
    window.key_press(Key::Space);
    wait(window, "the end", is(RunState::Finished));
}

fn click(window: &mut Window, label: &str) {
    window.get_by_label(label).click();
    window.run_steps(2);
}

/// Asks for a file by a dialog that a shortcut opens.
fn write_to(window: &mut Window, key: Key, button: &str, file: &Path) {
    window.key_press_modifiers(Modifiers::COMMAND, key);
    window.run_steps(2);
    window.get_by_role(Role::TextInput).focus();
    window.run_steps(2);
    window.key_press_modifiers(Modifiers::COMMAND, Key::A);
    window.event(Event::Text(file.display().to_string()));
    window.run_steps(2);
    window.get_by_role_and_label(Role::Button, button).click();
}

/// A dataset small enough to train in a moment.
fn dataset(folder: &Path, n_train: usize) -> PathBuf {
    let path = folder.join("room");
    let params =
        SyntheticParams { width: 64, height: 48, n_train, n_eval: 1, seed: 1, depth_noise: 0.0 };
    write(&params, &path, SyntheticLayout::Blender(DepthBits::Sixteen), &mut |_, _| {}).unwrap();
    path
}

/// Whether the middle of the picture shows more than the background.
fn picture_has_content(window: &mut Window) -> bool {
    let image = window.render().unwrap();
    let (w, h) = (image.width(), image.height());
    let mut colors = std::collections::BTreeSet::new();
    for y in (h / 4..3 * h / 4).step_by(7) {
        for x in (w / 10..w / 2).step_by(7) {
            colors.insert(image.get_pixel(x, y).0);
        }
    }
    colors.len() > 50
}

/// Picture or order of the splats come from another thread a moment after the splats themselves.
fn wait_for_picture(window: &mut Window) {
    let started = Instant::now();
    while !picture_has_content(window) {
        assert!(started.elapsed() < PATIENCE, "the scene is never drawn");
        window.step();
        std::thread::sleep(Duration::from_millis(20));
    }
}

#[test]
fn the_demo_trains_at_start_and_is_seen() {
    let _turn = turn();
    let Some(mut window) = window(Some(Subject::Demo), Painting::Auto) else { return };
    wait(&mut window, "training", is(RunState::Training));
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    wait_for_picture(&mut window);
    click(&mut window, "Pause");
    wait(&mut window, "pause", is(RunState::Paused));
    assert!(window.state().snapshot().frames_done > 0);
    window.get_by_label("Candidate search");
}

#[test]
fn the_gpu_painter_shows_the_same_scene() {
    let _turn = turn();
    let Some(mut window) = window(Some(Subject::Demo), Painting::Gpu) else { return };
    wait(&mut window, "splats", |s| s.n_drawn() > 100 && s.snapshot().frames_done >= 3);
    click(&mut window, "Pause");
    wait(&mut window, "pause", is(RunState::Paused));
    wait_for_picture(&mut window);
}

#[test]
fn a_dataset_goes_through_every_state() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    assert_eq!(window.state().snapshot().source, Source::Dataset);

    click(&mut window, "Step");
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    assert_eq!(window.state().snapshot().state, RunState::Paused);
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));
    assert_eq!(window.state().snapshot().frames_done, 4);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);

    // Unsaved training is never dropped unasked.
    click(&mut window, "Reset");
    window.get_by_label("Discard the trained scene?");
    click(&mut window, "Cancel");
    assert_eq!(window.state().snapshot().frames_done, 4);
    click(&mut window, "Reset");
    click(&mut window, "Discard");
    wait(&mut window, "ready again", is(RunState::Ready));
    assert_eq!(window.state().snapshot().frames_done, 0);
}

#[test]
fn export_writes_the_newest_state_and_the_file_opens_again() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);

    let file = folder.path().join("scene.glb");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().unsaved_frames == 0);
    let used = window.state().snapshot().used;
    assert_eq!(export::read(&file).unwrap().splats.len(), used);

    drop(window);
    let Some(mut viewer) = self::window(Some(Subject::Path(file)), Painting::Auto) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    wait(&mut viewer, "splats", |s| s.n_drawn() == used);
}

#[test]
fn a_saved_run_opens_where_it_stopped_and_goes_on() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let Some(mut window) = window(Some(Subject::Path(path.clone())), Painting::Auto) else {
        return;
    };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Step");
    wait(&mut window, "one frame", |s| s.snapshot().frames_done == 1);
    let file = folder.path().join("run.vbgs");
    write_to(&mut window, Key::S, "Save", &file);
    wait(&mut window, "the file", |s| s.snapshot().unsaved_frames == 0);
    let used = window.state().snapshot().used;
    drop(window);

    let open = |file: &Path| self::window(Some(Subject::Path(file.to_owned())), Painting::Auto);
    let Some(mut again) = open(&file) else { return };
    wait(&mut again, "the run", is(RunState::Paused));
    let snapshot = again.state().snapshot();
    assert_eq!((snapshot.source, snapshot.frames_done, snapshot.used), (Source::Dataset, 1, used));
    wait(&mut again, "splats", |s| s.n_drawn() == used);
    again.key_press(Key::Space);
    wait(&mut again, "the end", is(RunState::Finished));
    assert_eq!(again.state().snapshot().frames_done, 4);
    drop(again);

    std::fs::rename(&path, folder.path().join("elsewhere")).unwrap();
    let Some(mut viewer) = open(&file) else { return };
    wait(&mut viewer, "the model", is(RunState::Finished));
    assert_eq!(viewer.state().snapshot().source, Source::Model);
    let told = viewer.state().snapshot().notices.iter().any(|n| n.text.contains("cannot go on"));
    assert!(told, "why it cannot be trained");
    wait(&mut viewer, "splats", |s| s.n_drawn() == used);
}

#[test]
fn what_cannot_be_opened_is_said_and_what_was_open_stays() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(2);
    assert_eq!(window.state().snapshot().state, RunState::Empty);
    window.get_by_label("Try the synthetic scene");

    for (subject, word) in [
        (folder.path().join("nothing-here"), "nothing-here"),
        (folder.path().to_owned(), "expected"),
    ] {
        drop_on(&mut window, &subject);
        let told = |s: &Studio| {
            s.snapshot()
                .notices
                .last()
                .is_some_and(|n| n.kind == NoticeKind::Error && n.text.contains(word))
        };
        wait(&mut window, "the message", told);
        assert_eq!(window.state().snapshot().state, RunState::Empty);
    }
    drop_on(&mut window, &path);
    wait(&mut window, "ready", is(RunState::Ready));
    let opened = window.state().snapshot().opened.as_ref().unwrap().serial;
    drop_on(&mut window, &folder.path().join("nothing-here"));
    wait(&mut window, "the message", |s| s.snapshot().notices.len() >= 3);
    let snapshot = window.state().snapshot();
    assert_eq!(
        (snapshot.state, snapshot.opened.as_ref().unwrap().serial),
        (RunState::Ready, opened)
    );
    click(&mut window, "Dismiss");
    assert!(window.query_by_label("Dismiss").is_none());
}

/// A file dropped on the window.
#[derive(Debug)]
struct Dropped(PathBuf);

impl eframe::egui::DroppedFile for Dropped {
    fn path(&self) -> &Path {
        &self.0
    }

    fn bytes(&self) -> Result<Vec<u8>, String> {
        std::fs::read(&self.0).map_err(|e| e.to_string())
    }
}

fn drop_on(window: &mut Window, path: &Path) {
    window.input_mut().dropped_files.push(std::sync::Arc::new(Dropped(path.to_owned())));
    window.step();
}

#[test]
fn a_dataset_with_bad_frames_trains_on_the_others_and_counts_them() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let depth = find(&path, |name| {
        name.contains("depth") && name.contains("train") || name.contains("_depth_")
    });
    std::fs::write(&depth, b"not an image").unwrap();
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    let snapshot = window.state().snapshot();
    assert_eq!(snapshot.skipped.len() + snapshot.frames_done, 4, "{:?}", snapshot.skipped);
    assert_eq!(snapshot.skipped.len(), 1);
    window.run_steps(2);
    window.get_by_label("1 frames skipped");
}

/// First file below a folder whose path fits.
fn find(folder: &Path, fits: impl Fn(&str) -> bool + Copy) -> PathBuf {
    let mut folders = vec![folder.join("train"), folder.to_owned()];
    while let Some(next) = folders.pop() {
        let Ok(entries) = std::fs::read_dir(&next) else { continue };
        let mut entries: Vec<PathBuf> = entries.map(|e| e.unwrap().path()).collect();
        entries.sort();
        for entry in entries {
            if entry.is_dir() {
                folders.push(entry);
            } else if entry.to_string_lossy().contains("train") && fits(&entry.to_string_lossy()) {
                return entry;
            }
        }
    }
    panic!("no such file below {}", folder.display())
}

#[test]
fn the_camera_follows_the_pointer_and_keys() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    let home = settled(&mut window);
    drag(&mut window, PointerButton::Primary);
    let turned = settled(&mut window);
    assert_ne!(home, turned, "orbit");
    drag(&mut window, PointerButton::Secondary);
    let panned = settled(&mut window);
    assert_ne!(turned, panned, "pan");
    window.key_press(Key::F);
    window.step();
    assert_ne!(panned, settled(&mut window), "frame");
    window.key_press(Key::H);
    window.step();
    assert_eq!(home, settled(&mut window), "home");
}

fn drag(window: &mut Window, button: PointerButton) {
    let press = |pos: Pos2, pressed| Event::PointerButton {
        pos,
        button,
        pressed,
        modifiers: Modifiers::NONE,
    };
    let start = Pos2::new(300.0, 300.0);
    window.event(Event::PointerMoved(start));
    window.event(press(start, true));
    window.step();
    for i in 1..=5 {
        window.event(Event::PointerMoved(start + Vec2::new(12.0, 6.0) * i as f32));
        window.step();
    }
    window.event(press(start + Vec2::new(60.0, 30.0), false));
    window.event(Event::PointerMoved(Pos2::new(5.0, 635.0)));
    window.step();
}

/// The picture of the scene once it no longer changes.
fn settled(window: &mut Window) -> Vec<u8> {
    let started = Instant::now();
    let mut last = Vec::new();
    loop {
        for _ in 0..30 {
            window.step();
            std::thread::sleep(Duration::from_millis(10));
        }
        let image = window.render().unwrap();
        let middle: Vec<u8> = (150..500)
            .flat_map(|y| (50..550).flat_map(move |x| [(x, y)]))
            .flat_map(|(x, y)| image.get_pixel(x, y).0)
            .collect();
        if middle == last {
            return last;
        }
        assert!(started.elapsed() < PATIENCE, "the picture never settles");
        last = middle;
    }
}

#[test]
fn help_lists_every_shortcut_and_tabs_switch() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.key_press(Key::F1);
    window.run_steps(2);
    window.get_by_label("Left drag");
    window.get_by_label("Train exactly one frame");
    window.key_press(Key::F1);
    window.run_steps(2);
    assert!(window.query_by_label("Left drag").is_none());
    click(&mut window, "Scene");
    window.get_by_label("Nothing is open.");
    window.set_size(Vec2::new(640.0, 400.0));
    window.run_steps(2);
    window.render().unwrap();
}
