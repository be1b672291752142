//! Files and folders dropped on the window, usable and unusable.

use super::harness::{
    Window, click, close_notice, dataset, drop_all_on, drop_on, is, step, train, wait,
    wait_for_label, wait_for_text, window, write_to,
};
use crate::common::adapter::turn;
use eframe::egui::Key;
use egui_kittest::kittest::Queryable;
use std::io::{Cursor, Write};
use std::path::{Path, PathBuf};
use vbgs_studio::app::state::{Notice, NoticeKind, RunState, Subject};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};
use vbgs_studio::export;
use zip::ZipWriter;
use zip::write::SimpleFileOptions;

#[test]
fn what_cannot_be_opened_is_said_and_what_was_open_stays() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(2);
    assert_eq!(window.state().snapshot().state, RunState::Empty);
    window.get_by_label("Try the synthetic scene");

    for (n, subject, word) in [
        (1, folder.path().join("nothing-here"), "nothing-here"),
        (2, folder.path().to_owned(), "expected"),
    ] {
        drop_on(&mut window, &subject);
        let told = |s: &Studio| {
            let snapshot = s.snapshot();
            let newest = snapshot.notices.get(n - 1);
            newest.is_some_and(|n| n.kind == NoticeKind::Error && n.text.contains(word))
        };
        wait(&mut window, "the message", told);
        wait(&mut window, "nothing is open", is(RunState::Empty));
    }
    drop_on(&mut window, &path);
    wait(&mut window, "ready", is(RunState::Ready));
    let opened = window.state().snapshot().opened.as_ref().unwrap().serial;
    drop_on(&mut window, &folder.path().join("nothing-here"));
    // What opened has cleared the messages before it.
    wait(&mut window, "the message", |s| {
        s.snapshot().notices.iter().any(|n| n.text.contains("nothing-here"))
    });
    let snapshot = window.state().snapshot();
    assert_eq!(
        (snapshot.state, snapshot.opened.as_ref().unwrap().serial),
        (RunState::Ready, opened)
    );
    let told = |window: &Window| window.query_all_by_label_contains("nothing-here").count();
    window.run_steps(2);
    let before = told(&window);
    close_notice(&mut window);
    assert_eq!(told(&window) + 1, before, "the newest notice comes first");
}

#[test]
fn of_several_things_dropped_the_first_is_opened() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    drop_all_on(&mut window, &[&path, &folder.path().join("other")]);
    wait(&mut window, "ready", is(RunState::Ready));
    let snapshot = window.state().snapshot();
    let told = |n: &Notice| n.kind == NoticeKind::Warning && n.text.contains("1 other");
    assert!(snapshot.notices.iter().any(told), "{:?}", snapshot.notices);
    assert_eq!(snapshot.opened.as_ref().unwrap().path, Some(path));
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
    assert_eq!(
        snapshot.frames.skipped.len() + snapshot.frames_done,
        4,
        "{:?}",
        snapshot.frames.skipped
    );
    assert_eq!(snapshot.frames.skipped.len(), 1);
    window.run_steps(2);
    window.get_by_label("1 skipped");
}

/// The error of a folder inside a dataset offers the dataset.
#[test]
fn a_part_of_a_recording_offers_all_of_it_and_an_archive_opens_as_its_folder() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let room = folder.path().canonicalize().unwrap().join("room");
    let params = SyntheticParams { n_train: 2, n_eval: 0, ..small() };
    write(&params, &room, SyntheticLayout::Tum, &mut |_, _| {}).unwrap();
    let part = room.join("rgb");
    let expected = format!(
        "{}: found a part of a recording, expected all of it; open the folder above, {}",
        part.display(),
        room.display()
    );
    let opens = |s: &Studio| s.snapshot().opened.as_ref().and_then(|opened| opened.path.clone());
    // Once by the notice, once by the dialog.
    for asks in [false, true] {
        let Some(mut window) = window(None, Painting::Auto) else { return };
        window.run_steps(2);
        match asks {
            true => write_to(&mut window, Key::O, "Open", &part),
            false => drop_on(&mut window, &part),
        }
        wait_for_label(&mut window, &expected);
        assert_eq!(window.state().snapshot().notices.len(), usize::from(!asks));
        click(&mut window, "Open the folder above");
        wait(&mut window, "the recording", is(RunState::Ready));
        assert_eq!(opens(window.state()), Some(room.clone()));
        window.run_steps(2);
        assert!(window.query_by_label("Open the folder above").is_none());
    }

    let zipped = |name: &str, files: &[(String, Vec<u8>)]| {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (name, bytes) in files {
            zip.start_file(name, SimpleFileOptions::default()).unwrap();
            zip.write_all(bytes).unwrap();
        }
        let archive = folder.path().join(name);
        std::fs::write(&archive, zip.finish().unwrap().into_inner()).unwrap();
        archive
    };
    let archive = zipped("notes.zip", &[("notes/1.txt".to_owned(), b"none".to_vec())]);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    drop_on(&mut window, &archive);
    wait_for_label(
        &mut window,
        &format!(
            "{}: found a zip archive without photographs, expected images that are read; open the folder or archive of a recording",
            archive.display()
        ),
    );
    assert!(window.query_by_label("Open the folder above").is_none());
    let mut files = files_below(&room);
    for (name, _) in &mut files {
        *name = format!("room/{name}");
    }
    files.push(("__MACOSX/room/._rgb.txt".to_owned(), Vec::new()));
    let archive = zipped("room.zip", &files);
    write_to(&mut window, Key::O, "Open", &archive);
    train(&mut window);
    assert_eq!(opens(window.state()), Some(archive));
}

/// Names below a folder, with `/` as the separator, and the contents of all files.
fn files_below(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).unwrap() {
        let (path, name) = entry.map(|e| (e.path(), e.file_name())).unwrap();
        let name = name.into_string().unwrap();
        if path.is_dir() {
            let inner = files_below(&path).into_iter();
            found.extend(inner.map(|(below, bytes)| (format!("{name}/{below}"), bytes)));
        } else {
            found.push((name, std::fs::read(&path).unwrap()));
        }
    }
    found
}

fn small() -> SyntheticParams {
    SyntheticParams { width: 64, height: 48, depth_noise: 0.0, ..SyntheticParams::demo() }
}

/// Simulates an unplugged drive or a moved folder.
#[test]
fn a_dataset_that_vanishes_while_it_trains_leaves_what_was_learnt() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 60);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    step(&mut window);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done == 1);
    std::fs::remove_dir_all(&path).unwrap();
    window.key_press(Key::Space);
    let paused = |s: &Studio, n: usize| {
        s.snapshot().frames.skipped.len() == n && s.snapshot().state == RunState::Paused
    };
    // Some frames may have been read before.
    wait(&mut window, "the pause", |s| paused(s, 5));
    wait_for_text(&mut window, "training is paused: 5 frames in a row could not be read");
    // Space goes on, as it does once the drive is back.
    window.key_press(Key::Space);
    wait(&mut window, "the next pause", |s| paused(s, 10));
    let snapshot = window.state().snapshot();
    assert!(snapshot.frames_done < 50);
    let reason = &snapshot.frames.skipped.last().unwrap().message;
    assert!(reason.contains(".png"), "{reason}");
    let file = folder.path().join("scene.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| {
        s.snapshot().files.latest_write.is_some_and(|w| w.is_written)
    });
    assert!(export::read(&file).unwrap().splats.len() > 100);
}

/// Returns the first file below a folder whose path matches.
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
