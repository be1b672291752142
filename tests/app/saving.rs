//! Proposed file names, existing files, and actions that wait for a file to be written.

use super::harness::{
    PATIENCE, Window, click, dataset, drop_on, enter_path, is, press_in_dialog, train, wait,
    wait_for_label, wait_for_text, window, write_to,
};
use super::viewer::press;
use crate::common::adapter::turn;
use eframe::App;
use eframe::egui::accesskit::Role;
use eframe::egui::{Event, Key, RawInput, ViewportCommand, ViewportEvent, ViewportId};
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::export;

/// Beginning of the question about unsaved training.
const QUESTION: &str = "Discard “";

/// Writes a second dataset into a folder of its own.
fn other_dataset(folder: &Path) -> PathBuf {
    let folder = folder.join("elsewhere");
    std::fs::create_dir(&folder).unwrap();
    let path = folder.join("kitchen");
    std::fs::rename(dataset(&folder, 2), &path).unwrap();
    path
}

fn name(studio: &Studio) -> String {
    studio.snapshot().opened.as_ref().map_or_else(String::new, |opened| opened.name.clone())
}

/// Answers the question about unsaved training. The next dialog needs some passes to find its size and place.
fn answer(window: &mut Window, choice: &str) {
    click(window, choice);
    window.run_steps(4);
}

/// Requests the window to close; true if it does.
fn close(window: &mut Window) -> bool {
    let root = window.input_mut().viewports.entry(ViewportId::ROOT).or_default();
    root.events.push(ViewportEvent::Close);
    window.step();
    !commands(window).contains(&ViewportCommand::CancelClose)
}

/// Requests the minimised window to close as eframe does, without a UI pass; returns the viewport commands.
fn close_minimised(window: &mut Window) -> Vec<ViewportCommand> {
    let mut input = RawInput::default();
    let root = input.viewports.entry(ViewportId::ROOT).or_default();
    root.minimized = Some(true);
    root.events.push(ViewportEvent::Close);
    let (ctx, mut frame) = (window.ctx.clone(), eframe::Frame::_new_kittest());
    let output = ctx.run_logic(&input, |ctx| window.state_mut().logic(ctx, &mut frame));
    output.viewport_commands.get(&ViewportId::ROOT).cloned().unwrap_or_default()
}

fn commands(window: &Window) -> Vec<ViewportCommand> {
    window.output().viewport_output[&ViewportId::ROOT].commands.clone()
}

#[test]
fn an_older_file_is_replaced_only_when_the_user_says_so() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    for (key, button, file) in [(Key::S, "Save", "old.vbgs"), (Key::E, "Export", "old.ply")] {
        let file = folder.path().join(file);
        std::fs::write(&file, "older").unwrap();
        write_to(&mut window, key, button, &file);
        wait_for_label(&mut window, "Replace the existing file?");
        click(&mut window, "Choose another name");
        assert!(window.query_by_label("Replace the existing file?").is_none());
        press_in_dialog(&mut window, button);
        wait_for_label(&mut window, "Replace the existing file?");
        press(&mut window, Key::Escape);
        assert!(window.query_by_label("Replace the existing file?").is_none());
        window.get_by_role(Role::TextInput); // the dialog itself has stayed
        assert_eq!(std::fs::read(&file).unwrap(), b"older");
        press_in_dialog(&mut window, button);
        wait_for_label(&mut window, "Replace the existing file?");
        click(&mut window, "Replace");
        wait(&mut window, "the file", |_| std::fs::read(&file).unwrap() != b"older");
    }
    // A folder cannot be replaced by a file.
    write_to(&mut window, Key::E, "Export", folder.path());
    let problem = format!("{} is a folder: add the name of a file", folder.path().display());
    wait_for_label(&mut window, &problem);
    assert!(window.query_by_label("Replace the existing file?").is_none());
}

#[test]
fn what_waits_goes_on_after_the_file_was_written() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, kitchen) = (dataset(folder.path(), 2), other_dataset(folder.path()));
    for (choice, button, file) in
        [("Save first…", "Save", "room.vbgs"), ("Export first…", "Export", "room.ply")]
    {
        let Some(mut window) = window(Some(Subject::Path(room.clone())), Painting::Auto) else {
            return;
        };
        train(&mut window);
        drop_on(&mut window, &kitchen);
        answer(&mut window, choice);
        press_in_dialog(&mut window, button);
        wait(&mut window, "the kitchen", |s| name(s) == "kitchen");
        assert!(folder.path().join(file).is_file(), "beside the dataset, as proposed");
        window.run_steps(2);
        assert!(window.query_by_label_contains(QUESTION).is_none());
    }
    assert!(export::read(&folder.path().join("room.ply")).is_ok());
}

#[test]
fn what_waits_is_given_up_where_no_file_was_written() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, kitchen) = (dataset(folder.path(), 2), other_dataset(folder.path()));
    let Some(mut window) = window(Some(Subject::Path(room)), Painting::Auto) else { return };
    train(&mut window);

    // Cancelled: nothing is opened, neither now nor after a later save.
    drop_on(&mut window, &kitchen);
    answer(&mut window, "Save first…");
    press(&mut window, Key::Escape);
    assert_eq!(name(window.state()), "room");

    // Failed: the dialog says so until it is cancelled.
    let nowhere = folder.path().join("missing/room.vbgs");
    drop_on(&mut window, &kitchen);
    answer(&mut window, "Save first…");
    enter_path(&mut window, &nowhere);
    press_in_dialog(&mut window, "Save");
    wait_for_text(&mut window, "missing: found no folder, expected one to write to");
    press(&mut window, Key::Escape);
    assert_eq!(window.state().snapshot().files.unsaved_frames, 2);

    write_to(&mut window, Key::S, "Save", &folder.path().join("later.vbgs"));
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    window.run_steps(4);
    assert_eq!(
        (name(window.state()), window.state().snapshot().state),
        ("room".into(), RunState::Finished)
    );
}

/// Text of the field of the open dialog.
fn typed(window: &Window) -> String {
    window.get_by_role(Role::TextInput).value().unwrap()
}

#[test]
fn a_dialog_stays_open_with_its_error_and_what_was_typed() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let (room, kitchen) = (dataset(folder.path(), 2), other_dataset(folder.path()));
    let Some(mut window) = window(Some(Subject::Path(room)), Painting::Auto) else { return };
    train(&mut window);
    let n_told = |window: &Window| window.state().snapshot().notices.len();
    let before = n_told(&window);
    for (key, button, name, error) in [
        (Key::E, "Export", "scene.xyz", "scene.xyz: "),
        (Key::E, "Export", "gone/scene.ply", "gone: found no folder, expected one to write to"),
        (Key::S, "Save", "gone/run.vbgs", "gone: found no folder, expected one to write to"),
        (Key::O, "Open", "nowhere", "nowhere: expected a dataset folder, found nothing"),
        (Key::O, "Open", "text.ply", "text.ply: "),
    ] {
        let file = folder.path().join(name);
        if name == "text.ply" {
            std::fs::write(&file, "no model").unwrap();
        }
        write_to(&mut window, key, button, &file);
        wait_for_text(&mut window, error);
        assert_eq!(typed(&window), file.display().to_string());
        // Keys are still text, not shortcuts.
        window.get_by_role(Role::TextInput).focus();
        window.run_steps(2);
        window.key_press(Key::End);
        window.event(Event::Text("t".to_owned()));
        window.run_steps(2);
        assert_eq!(typed(&window), format!("{}t", file.display()));
        assert!(window.query_all_by_label_contains(error).next().is_none(), "outdated");
        press(&mut window, Key::Escape);
        press(&mut window, Key::Escape);
        assert!(window.query_by_role(Role::TextInput).is_none(), "{name}");
        assert!(window.query_by_label_contains(QUESTION).is_none(), "nothing can be opened");
    }
    assert_eq!(n_told(&window), before);

    // A file that cannot be opened is no reason to ask, one that can is.
    drop_on(&mut window, &folder.path().join("nowhere"));
    wait_for_text(&mut window, "nowhere: expected a dataset folder, found nothing");
    assert!(window.query_by_label_contains(QUESTION).is_none());
    assert_eq!(window.state().snapshot().state, RunState::Finished);
    write_to(&mut window, Key::O, "Open", &kitchen);
    answer(&mut window, "Discard");
    wait(&mut window, "the kitchen", |s| name(s) == "kitchen");
}

#[test]
fn closing_goes_on_after_the_file_was_written() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    assert!(close(&mut window), "nothing is lost");
    train(&mut window);
    assert!(!close(&mut window));
    click(&mut window, "Cancel");
    assert!(window.query_by_label_contains(QUESTION).is_none());

    assert!(!close(&mut window), "closing needs confirmation again");
    answer(&mut window, "Save first…");
    assert!(!close(&mut window), "the window stays open while the dialog is open");
    window.get_by_role_and_label(Role::Button, "Save").click();
    let started = Instant::now();
    while !commands(&window).contains(&ViewportCommand::Close) {
        assert!(started.elapsed() < PATIENCE, "the window stays");
        window.step();
        std::thread::sleep(Duration::from_millis(5));
    }
    assert!(folder.path().join("room.vbgs").is_file());
    assert!(close(&mut window));
}

#[test]
fn a_minimised_window_with_something_to_lose_comes_up_and_asks() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    assert_eq!(close_minimised(&mut window), [], "nothing is lost");
    train(&mut window);
    let answer = close_minimised(&mut window);
    assert!(answer.contains(&ViewportCommand::CancelClose), "{answer:?}");
    assert!(answer.contains(&ViewportCommand::Minimized(false)), "{answer:?}");
    window.run_steps(2);
    window.get_by_label_contains(QUESTION);
}
