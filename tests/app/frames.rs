//! The frame strip below the viewport.

use super::harness::{
    PATIENCE, Window, click, dataset, is, reset, train, wait, wait_for_label, wait_for_text, window,
};
use super::viewer::{position, press};
use crate::common::adapter::turn;
use crate::common::layouts::{TestLayout, write};
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2};
use egui_kittest::kittest::Queryable;
use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Instant;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::dataset::synthetic::SyntheticParams;

fn middle(window: &Window, label: &str) -> Pos2 {
    window.get_by_label(label).rect().center()
}

fn point_at(window: &mut Window, at: Pos2, pressed: Option<bool>) {
    window.event(Event::PointerMoved(at));
    window.step();
    if let Some(pressed) = pressed {
        let (button, modifiers) = (PointerButton::Primary, Modifiers::NONE);
        window.event(Event::PointerButton { pos: at, button, pressed, modifiers });
        window.run_steps(2);
    }
}

#[test]
fn a_click_shows_the_camera_and_a_drag_previews_others() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Some(Subject::Path(dataset(folder.path(), 5)));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    wait_for_label(&mut window, "Trained in the dataset's order, every frame");
    window.run_steps(2);
    assert_eq!(position(&window), None);
    // Frame 1 is the held-out view, which is a split of its own.
    let started = Instant::now();
    while position(&window).is_none() {
        assert!(started.elapsed() < PATIENCE, "a click shows no camera");
        // Results of loading may have moved the strip between press and release, so retry.
        let at = middle(&window, "Frame 3");
        point_at(&mut window, at, Some(true));
        point_at(&mut window, at, Some(false));
    }
    assert_eq!(position(&window), Some((1, 1)));

    let mut to = middle(&window, "Frame 5");
    while position(&window) != Some((1, 3)) {
        assert!(started.elapsed() < PATIENCE, "a drag previews nothing under the pointer");
        point_at(&mut window, to, Some(false));
        let from = middle(&window, "Frame 1");
        to = middle(&window, "Frame 5");
        point_at(&mut window, from, Some(true));
        for i in 1..=4 {
            point_at(&mut window, from.lerp(to, 0.25 * i as f32), None);
        }
        window.run_steps(2);
    }
    point_at(&mut window, to, Some(false));
    window.run_steps(2);
    assert_eq!(position(&window), Some((1, 1)), "the camera returns after the drag");

    press(&mut window, Key::T);
    assert!(window.query_by_label("Frame 1").is_none());
    wait_for_label(&mut window, "Trained in the dataset's order, every frame");
    press(&mut window, Key::T);
    window.get_by_label("Frame 1");
}

/// Numbers of colours in the photograph and in the depth picture of a frame of the strip.
fn colors_of(window: &mut Window, label: &str) -> [usize; 2] {
    window.run_steps(2);
    let cell = window.get_by_label(label).rect();
    let image = window.render().unwrap();
    let rows = [(0.1, 0.4), (0.52, 0.8)];
    rows.map(|(top, bottom)| {
        let part = cell.shrink2(eframe::egui::vec2(0.2 * cell.width(), 0.0));
        let at = |share: f32| (part.top() + share * part.height()) as u32;
        let pixels = (at(top)..at(bottom))
            .flat_map(|y| (part.left() as u32..part.right() as u32).map(move |x| (x, y)));
        pixels.map(|(x, y)| image.get_pixel(x, y).0).collect::<BTreeSet<_>>().len()
    })
}

#[test]
fn pictures_of_the_strip_come_from_training_and_survive_a_reset() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 7);
    let subject = Some(Subject::Path(path.clone()));
    let Some(mut window) = window(subject, Painting::Auto) else { return };
    // The folded strip decodes nothing itself.
    wait(&mut window, "ready", is(RunState::Ready));
    press(&mut window, Key::T);
    train(&mut window);
    let mut images = Vec::new();
    for folder in [path.clone(), path.join("train")] {
        let found = fs::read_dir(folder).into_iter().flatten().flatten().map(|entry| entry.path());
        let is_late = |file: &PathBuf| {
            let name = file.file_name().unwrap_or_default().to_string_lossy().into_owned();
            name.ends_with(".png")
                && ["r_4", "r_5", "r_6"].iter().any(|part| name.starts_with(part))
        };
        images.extend(found.filter(is_late));
    }
    assert_eq!(images.len(), 6, "three photographs and depth images: {images:?}");
    // The header stays, so that the frames are listed; their pixels cannot be decoded any more.
    for image in images {
        fs::write(&image, &fs::read(&image).unwrap()[..64]).unwrap();
    }
    press(&mut window, Key::T);
    // The first frames may be decoded before training is watched; frame 1 is the held-out view.
    let check = |window: &mut Window| {
        for label in ["Frame 6", "Frame 7", "Frame 8"] {
            let colors = colors_of(window, label);
            assert!(colors.iter().all(|&n| n > 60), "{label}: {colors:?} colours");
        }
    };
    check(&mut window);
    reset(&mut window);
    click(&mut window, "Discard");
    wait(&mut window, "ready", is(RunState::Ready));
    for _ in 0..10 {
        window.run_steps(2);
        std::thread::sleep(std::time::Duration::from_millis(20));
    }
    check(&mut window);
}

#[test]
#[ignore = "prints figures of time"]
fn figures_of_the_pictures_of_the_strip() {
    let params = SyntheticParams { width: 640, height: 480, n_train: 1, ..SyntheticParams::demo() };
    let room = vbgs_studio::dataset::synthetic::dataset(&params).unwrap();
    let frame = room.splits[room.training_split().unwrap()].frames[0].load().unwrap();
    let pictures = vbgs_studio::app::viewer::thumbnails::TrainedThumbnails::default();
    let times: Vec<f64> = (0..40)
        .map(|i| {
            let started = Instant::now();
            pictures.add(1, i, &frame);
            1e3 * started.elapsed().as_secs_f64()
        })
        .collect();
    println!("ms of a frame of 640x480: {:.2}", times.iter().copied().fold(f64::MAX, f64::min));
}

#[test]
fn skipped_frames_tell_their_reason_and_trained_ones_how_well() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 4);
    let damaged = depth_of(&path, 2);
    fs::write(&damaged, b"no image at all").unwrap();
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait_for_label(&mut window, "1 skipped");
    let skipped = window.state().snapshot().frames.skipped[0].message.clone();
    let at = middle(&window, "Frame 4");
    point_at(&mut window, at, None);
    wait_for_text(&mut window, &format!("Skipped: {skipped}"));
    let at = middle(&window, "Frame 5");
    point_at(&mut window, at, None);
    wait_for_text(&mut window, "Trained, number 4 of the run");
    // Frame 1 is the held-out view, which the Quality tab measures.
    wait(&mut window, "quality", |studio| studio.quality().result().is_some());
    let psnr = window.state().quality().views[0].psnr;
    let at = middle(&window, "Frame 1");
    point_at(&mut window, at, None);
    wait_for_text(&mut window, &format!("{psnr:.1} dB, SSIM"));
    wait_for_text(&mut window, "as a held-out view");
}

/// The depth file of a frame of the training split.
fn depth_of(path: &Path, index: usize) -> std::path::PathBuf {
    let dataset =
        vbgs_studio::dataset::open(path, &vbgs_studio::dataset::LoadOptions::default()).unwrap();
    let split = dataset.training_split().unwrap();
    dataset.splits[split].frames[index].depth_path().unwrap().to_owned()
}

/// Only visible frames are laid out and decoded.
#[test]
fn ten_thousand_frames_cost_what_is_on_screen() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train: 4,
        n_eval: 0,
        seed: 1,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, TestLayout::Nerfstudio, &mut |_, _| {}).unwrap();
    let file = path.join("transforms.json");
    let mut json: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(&file).unwrap()).unwrap();
    let frames = json["frames"].as_array().unwrap().clone();
    let frame = |i: usize| {
        let mut frame = frames[i % frames.len()].clone();
        let photograph = path.join(frame["file_path"].as_str().unwrap());
        let own = photograph.with_file_name(format!("{i}.png"));
        fs::hard_link(&photograph, &own).unwrap();
        frame["file_path"] = own.strip_prefix(&path).unwrap().to_str().unwrap().into();
        frame
    };
    json["frames"] = (0..10_000).map(frame).collect();
    fs::write(&file, json.to_string()).unwrap();
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    press(&mut window, Key::OpenBracket);
    window.run_steps(3);
    let n_frames = window.state().view().camera.frame_ref().unwrap().n_frames();
    assert!(n_frames >= 10_000, "{n_frames}");
    window.get_by_label(&format!("Frame {n_frames}"));
    assert!(window.query_by_label("Frame 1").is_none(), "scrolled past");
    let laid_out = window.query_all_by_label_contains("Frame ").count();
    assert!(laid_out < 40, "{laid_out} frames are laid out");
}
