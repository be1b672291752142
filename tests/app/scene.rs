//! The scene preset in the window: growing number of components, the preparation overlay, training settings,
//! export to plain splats.

use super::detail::type_into;
use super::harness::{
    click, close_notice, dataset, drop_on, is, paper_window, reset, step, train, until, wait,
    wait_for_label, window, write_to,
};
use super::viewer::{choose, evaluated, position, press, session};
use crate::common::adapter::turn;
use eframe::egui::{Key, Modifiers};
use egui_kittest::kittest::Queryable;
use std::cell::RefCell;
use std::path::Path;
use std::sync::Arc;
use vbgs_studio::app::frame_outcomes::{FrameOutcomes, FrameState};
use vbgs_studio::app::state::{HISTORY, NoticeKind, Opened, RunState, Subject};
use vbgs_studio::app::training::TrainSettings;
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::app::wording;
use vbgs_studio::app::worker::{Worker, WorkerOrder};
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::calibration::Calibration;
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};
use vbgs_studio::export;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;

const BOTH: [Painting; 2] = [Painting::Auto, Painting::Gpu];

#[test]
fn preparation_is_painted_over_the_photograph() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    for painting in BOTH {
        let Some(mut window) = window(Some(Subject::Path(path.clone())), painting) else { return };
        train(&mut window);
        choose(&mut window, 0, "Preparation");
        let view = window.state().view();
        assert_eq!(
            (view.comparison.mode(), position(&window)),
            (ViewMode::Preparation, Some((0, 0)))
        );
        for text in ["used", "too oblique"] {
            wait_for_label(&mut window, text);
        }
        assert!(
            window.query_by_label_contains("PSNR").is_none(),
            "painted pixels are not measured"
        );
        press(&mut window, Key::G);
        assert_eq!(window.state().view().comparison.mode(), ViewMode::PhotoWipe);
        assert!(window.query_by_label("used").is_none());
    }
}

#[test]
fn the_preset_is_chosen_in_settings_and_reset_trains_by_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = paper_window(&path, Painting::Auto) else { return };
    click(&mut window, "Latency");
    step(&mut window);
    wait_for_label(&mut window, "Candidate search");
    assert_eq!(window.state().snapshot().model.components, 100_000);

    click(&mut window, "Settings");
    click(&mut window, "Scene preset");
    click(&mut window, "Details");
    type_into(&mut window, "Budget", "25000");
    assert_eq!(window.state().snapshot().model.components, 100_000, "until the next run");
    click(&mut window, "Summary");
    reset(&mut window);
    click(&mut window, "Discard");
    wait(&mut window, "a scene", |s| s.snapshot().model.components == 0);
    step(&mut window);
    wait(&mut window, "a frame", |s| s.snapshot().frames_done == 1);
    let components = window.state().snapshot().model.components;
    assert!((1..25_000).contains(&components), "{components}");
    wait_for_label(
        &mut window,
        &format!("{} of at most 25,000 splats", wording::grouped(components)),
    );
}

#[test]
fn a_scene_tells_its_settings_and_is_exported_as_chosen() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    click(&mut window, "Summary");
    for label in ["Splat size", "Budget", "Sensor", "Preparation", "Calibration"] {
        window.get_by_label(label);
    }
    // Otherwise textures become small splats, however many for each.
    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    click(&mut window, "Leave out");
    press(&mut window, Key::Escape);
    let file = folder.path().join("one.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let one = export::read(&file).unwrap().splats;
    assert!(one.iter().all(|splat| splat.opacity < 1.0));

    window.key_press_modifiers(Modifiers::COMMAND, Key::E);
    click(&mut window, "4");
    press(&mut window, Key::Escape);
    assert!(window.query_by_label("4").is_none(), "the dialog is closed");
    let file = folder.path().join("four.ply");
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |_| file.exists());
    assert_eq!(export::read(&file).unwrap().splats.len(), 4 * one.len());
}

/// Multiplies the depth codes of a dataset by ten.
fn spoil_unit(path: &Path) {
    for split in std::fs::read_dir(path).unwrap() {
        let Ok(files) = std::fs::read_dir(split.unwrap().path()) else { continue };
        for file in files.map(|f| f.unwrap().path()) {
            if file.to_string_lossy().ends_with("depth.png") {
                let mut depth = image::open(&file).unwrap().into_luma16();
                depth.pixels_mut().for_each(|p| p.0[0] *= 10);
                depth.save(&file).unwrap();
            }
        }
    }
}

#[test]
fn depth_in_a_wrong_unit_is_said() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("room");
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train: 2,
        n_eval: 1,
        seed: 1,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, SyntheticLayout::SevenScenes, &mut |_, _| {}).unwrap();
    spoil_unit(&path);
    let Some(mut window) = window(None, Painting::Auto) else { return };
    drop_on(&mut window, &path);
    wait(&mut window, "the message", |s| !s.snapshot().notices.is_empty());
    let notice = window.state().snapshot().notices[0].clone();
    assert_eq!(notice.kind, NoticeKind::Error);
    assert!(notice.text.contains("the depth scale"), "{}", notice.text);
}

#[test]
fn a_calibration_is_dropped_on_its_dataset() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let file = folder.path().join("room.ron");
    let camera = "(focal: (62.0, 61.0), principal: (31.0, 25.0), offset: (0.05, 0.01, 0.0))";
    std::fs::write(&file, format!("(color_camera: {camera}, depth_scale: 1.01)")).unwrap();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    drop_on(&mut window, &file);
    wait(&mut window, "the message", |s| !s.snapshot().notices.is_empty());
    let notice = window.state().snapshot().notices[0].clone();
    assert!(
        notice.text.contains("room.ron: a calibration applies to a dataset"),
        "{}",
        notice.text
    );
    close_notice(&mut window);

    drop_on(&mut window, &path);
    wait(&mut window, "ready", is(RunState::Ready));
    let serial = |s: &Studio| s.snapshot().opened.as_ref().unwrap().serial;
    let before = serial(window.state());
    drop_on(&mut window, &file);
    wait(&mut window, "the dataset again", |s| serial(s) > before);
    let opened = window.state().snapshot().opened.clone().unwrap();
    let calibration = |opened: &Opened| opened.scene().unwrap().surface.calibration.clone();
    let read = Calibration::read(&file).unwrap();
    assert_eq!(calibration(&opened).as_ref(), Some(&read));
    window.key_press(Key::Space);
    wait(&mut window, "the end", is(RunState::Finished));

    press(&mut window, Key::G);
    let options = window.state().view().settings.measured();
    let overrides = SceneOverrides { calibration: Some(read.clone()), ..SceneOverrides::default() };
    let expected = evaluated(&session(&path, overrides), (0, 0), options);
    wait_for_label(&mut window, &expected);

    reset(&mut window);
    click(&mut window, "Discard");
    wait(&mut window, "the start", |s| s.snapshot().frames_done == 0);
    let opened = window.state().snapshot().opened.clone().unwrap();
    assert_eq!(calibration(&opened), Some(read), "its cameras stay corrected");
}

/// Photographs are drawn at random, so that some wait for longer than a snapshot reports their frame.
#[test]
fn photographs_that_wait_longer_than_frames_are_shown_still_tell_how_they_compared() {
    let folder = tempfile::tempdir().unwrap();
    let params = SyntheticParams {
        width: 32,
        height: 24,
        n_train: HISTORY + 100,
        n_eval: 0,
        ..SyntheticParams::demo()
    };
    write(&params, folder.path(), SyntheticLayout::SevenScenes, &mut |_, _| {}).unwrap();
    let worker = Worker::start_with(Arc::new(|| {}), Vec::new()).unwrap();
    let mut settings = TrainSettings { autosave_s: None, ..TrainSettings::default() };
    settings.scene.shuffle_buffer = Some(150);
    worker.send(WorkerOrder::TrainBy(Box::new(settings)));
    worker.send(WorkerOrder::Open(Subject::Path(folder.path().to_owned())));
    worker.send(WorkerOrder::Train);
    let outcomes = RefCell::new(FrameOutcomes::default());
    until("the end", || {
        let snapshot = worker.snapshot();
        outcomes.borrow_mut().update(&snapshot);
        snapshot.state == RunState::Finished
    });
    let plan = worker.snapshot().opened.as_ref().unwrap().plan.clone().unwrap();
    assert!(plan.frames.len() > HISTORY, "{}", plan.frames.len());
    let outcomes = outcomes.into_inner();
    let untold = plan.frames.iter().filter(|&&frame| {
        let state = outcomes.state_of((plan.split, frame), "");
        !matches!(state, FrameState::Trained(_, Some(outcome)) if outcome.psnr_before.is_some())
    });
    assert_eq!(untold.collect::<Vec<_>>(), [&0; 0]);
}
