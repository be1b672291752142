//! Following a recording while it is written.

use super::harness::{Window, click, drop_on, is, live, train, wait, wait_for_label, window};
use crate::common::adapter::turn;
use egui_kittest::kittest::Queryable;
use std::path::Path;
use std::sync::Arc;
use std::time::Duration;
use vbgs_studio::app::state::RunState;
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::growing::END_MARKER;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write, write_live};

const ROOM: SyntheticParams = SyntheticParams {
    width: 64,
    height: 48,
    n_train: 10,
    n_eval: 0,
    seed: 1,
    depth_noise: 0.0,
    ..SyntheticParams::demo()
};

fn has_trained(window: &mut Window, n: usize) {
    wait(window, "frames", |studio| studio.snapshot().frames_done >= n);
}

#[test]
fn a_recording_is_trained_from_before_its_first_frame_to_its_end() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    let Some(mut window) = window(None, Painting::Auto) else { return };
    live(&mut window);
    wait(&mut window, "the switch", |studio| studio.snapshot().following.is_on);
    drop_on(&mut window, &path);
    wait(&mut window, "waiting", is(RunState::Waiting));
    wait_for_label(&mut window, "Waiting");
    wait_for_label(&mut window, &format!("Waiting for the first frame of {}", path.display()));

    let recorder = std::thread::spawn(move || {
        let mut due = |_, _| std::thread::sleep(Duration::from_millis(50));
        write_live(&ROOM, &path, SyntheticLayout::Tum, &mut due).unwrap();
    });
    wait(&mut window, "the end", is(RunState::Finished));
    recorder.join().unwrap();
    let snapshot = window.state().snapshot();
    // The first and the ninth of the ten frames are held out.
    assert_eq!((snapshot.frames_done, snapshot.n_frames), (8, 8));
    assert!(snapshot.frames.skipped.is_empty(), "{:?}", snapshot.frames.skipped);
    assert!(
        !snapshot.following.is_on && snapshot.following.recording.is_none(),
        "the switch is off again"
    );
    assert!(snapshot.notices.iter().any(|n| n.text.contains("The recording has ended")));
    let opened = snapshot.opened.as_ref().unwrap();
    let cameras = opened.dataset.as_ref().unwrap().splits[0].frames.len();
    assert_eq!(cameras, 10, "the camera of the last photograph is available");
    wait(&mut window, "splats", |studio| studio.n_drawn() > 100);
}

#[test]
fn the_switch_follows_what_is_open_and_ends_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    write(&ROOM, &path, SyntheticLayout::SevenScenes, &mut |_, _| ()).unwrap();
    let later = folder.path().join("later");
    std::fs::create_dir(&later).unwrap();
    move_last_frames(&path.join("train"), &later);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    drop_on(&mut window, &path);
    train(&mut window);
    assert_eq!(window.state().snapshot().frames_done, 5);

    live(&mut window);
    wait_for_label(&mut window, "following, 5 frames, waiting");
    wait_for_label(&mut window, "Live: waiting for the next frame");
    assert_eq!(window.state().snapshot().state, RunState::Training);
    move_last_frames(&later, &path.join("train"));
    has_trained(&mut window, 8);
    wait_for_label(&mut window, "following, 8 frames, waiting");
    live(&mut window);
    wait(&mut window, "the end", is(RunState::Finished));
    assert!(window.query_by_label("following, 8 frames, waiting").is_none());
    assert_eq!(window.state().snapshot().frames_done, 8);

    // Follow the finished run again: the recorder's end marker ends it this time.
    live(&mut window);
    wait_for_label(&mut window, "following, 8 frames, waiting");
    click(&mut window, "Pause");
    wait(&mut window, "pause", is(RunState::Paused));
    std::fs::write(path.join(END_MARKER), "").unwrap();
    click(&mut window, "Train");
    wait(&mut window, "the end", is(RunState::Finished));
}

#[test]
fn waiting_costs_nothing() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    live(&mut window);
    wait(&mut window, "the switch", |studio| studio.snapshot().following.is_on);
    drop_on(&mut window, folder.path());
    wait(&mut window, "waiting", is(RunState::Waiting));
    let told = |studio: &Studio| {
        let snapshot = studio.snapshot();
        snapshot.following.recording.as_ref().is_some_and(|followed| {
            followed.problem.as_deref().is_some_and(|text| text.contains("an empty folder"))
        })
    };
    wait(&mut window, "the reason", told);
    // Publishing a snapshot wakes the window, so an idle worker must not publish.
    let before = window.state().snapshot();
    std::thread::sleep(Duration::from_millis(500));
    assert!(Arc::ptr_eq(&before, &window.state().snapshot()), "waiting publishes snapshots");
    live(&mut window);
    wait(&mut window, "nothing", is(RunState::Empty));
}

/// Moves the frames from number 6 on.
fn move_last_frames(from: &Path, to: &Path) {
    for entry in std::fs::read_dir(from).unwrap() {
        let name = entry.unwrap().file_name().into_string().unwrap();
        if name["frame-".len()..][..6].parse::<usize>().unwrap() >= 6 {
            std::fs::rename(from.join(&name), to.join(&name)).unwrap();
        }
    }
}
