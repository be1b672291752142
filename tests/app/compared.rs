//! Comparing the scene with a second model: opening, wiping, measuring, removing.

use super::harness::{
    Window, click, dataset, drop_on, enter_path, press_in_dialog, settled, train, wait,
    wait_for_label, wait_for_picture, wait_for_text, window, write_to,
};
use super::viewer::{choose, open_menu, press};
use crate::common::adapter::turn;
use eframe::egui::{Event, Key, Modifiers};
use egui_kittest::kittest::{NodeT, Queryable};
use std::path::Path;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::export::{ModelFormat, WriteOptions, write};
use vbgs_studio::model::splat::splats::Splat;

/// Writes a model that fills the view of every camera of the room with pure green.
fn green(path: &Path) {
    let splat = Splat {
        mean: [0.0; 3],
        opacity: 1.0,
        color: [0.0, 1.0, 0.0],
        scale: [30.0; 3],
        rotation: [1.0, 0.0, 0.0, 0.0],
    };
    let wall: Vec<Splat> = (0..27)
        .map(|i| {
            let at = |n: i32| (i / n % 3 - 1) as f32;
            Splat { mean: [at(1), at(3), at(9)], ..splat }
        })
        .collect();
    write(path, &wall, &WriteOptions::new(ModelFormat::from_path(path).unwrap())).unwrap();
}

/// Opens a second model through the menu above the viewport.
fn compare_with(window: &mut Window, path: &Path) {
    choose(window, 0, "Compare with a model…");
    enter_path(window, path);
    press_in_dialog(window, "Compare");
    window.run_steps(2);
}

/// Name of the second model in the window.
fn name(window: &Window) -> String {
    window.state().view().comparison.model().unwrap().name.clone()
}

/// Shares of nearly pure green pixels left and right of the viewport's middle.
fn green_shares(window: &mut Window) -> [f64; 2] {
    settled(window);
    let left = window.get_all_by_label("Scene").last().unwrap().rect().left();
    let name = name(window);
    let right = window.get_all_by_label(&name).last().unwrap().rect().right();
    let image = window.render().unwrap();
    let middle = 0.5 * (left + right);
    // Excludes the divider and the edges of the captions.
    let strips = [(left + 20.0, middle - 30.0), (middle + 30.0, right - 20.0)];
    strips.map(|(from, to)| {
        let pixels: Vec<_> = (220..420)
            .flat_map(|y| (from as u32..to as u32).map(move |x| (x, y)))
            .map(|(x, y)| image.get_pixel(x, y).0)
            .collect();
        let is_green = |[r, g, b, _]: &&[u8; 4]| *g > 200 && *r < 60 && *b < 60;
        pixels.iter().filter(is_green).count() as f64 / pixels.len() as f64
    })
}

#[test]
fn a_second_model_is_wiped_to_measured_and_removed() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 3);
    let file = folder.path().join("green.ply");
    green(&file);
    for painting in [Painting::Auto, Painting::Gpu] {
        let Some(mut window) = window(Some(Subject::Path(path.clone())), painting) else { return };
        train(&mut window);
        wait_for_picture(&mut window);
        press(&mut window, Key::CloseBracket);
        compare_with(&mut window, &file);
        wait(&mut window, "the model", |s| s.view().comparison.mode() == ViewMode::ModelWipe);
        let [scene, model] = green_shares(&mut window);
        assert!(scene < 0.05 && model > 0.9, "{painting:?}: {scene} left, {model} right");

        // At the camera of a photograph, both models are measured against it.
        let name = name(&window);
        assert!(name.ends_with("/green.ply"), "{name}");
        wait_for_text(&mut window, &format!("dB · {name} "));
        choose(&mut window, 0, "Model difference");
        wait_for_label(&mut window, &format!("|Scene − {name}| × 8"));

        choose(&mut window, 0, "Remove second model");
        window.run_steps(2);
        let view = window.state().view();
        assert_eq!(
            (view.comparison.mode(), view.comparison.model().is_none()),
            (ViewMode::Single, true)
        );
        open_menu(&mut window, "Compare");
        assert!(window.get_by_label("Wipe models").accesskit_node().is_disabled());
        press(&mut window, Key::Escape);
        assert!(window.state().snapshot().notices.iter().all(|n| n.kind != NoticeKind::Error));
    }
}

#[test]
fn a_broken_second_model_is_a_notice_and_nothing_else_changes() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 40);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    wait(&mut window, "ready", |s| s.snapshot().state == RunState::Ready);
    click(&mut window, "Train");
    wait(&mut window, "frames", |s| s.snapshot().frames_done > 1);
    let good = folder.path().join("green.ply");
    green(&good);
    // Through the list of actions, while frames are trained.
    window.key_press_modifiers(Modifiers::COMMAND, Key::P);
    window.run_steps(2);
    window.event(Event::Text("compare with a model".to_owned()));
    window.run_steps(2);
    window.key_press(Key::Enter);
    window.run_steps(3);
    enter_path(&mut window, &good);
    press_in_dialog(&mut window, "Compare");
    wait(&mut window, "the model", |s| s.view().comparison.mode() == ViewMode::ModelWipe);

    let broken = folder.path().join("broken.ply");
    std::fs::write(&broken, "ply\nnothing of the kind").unwrap();
    compare_with(&mut window, &broken);
    wait(&mut window, "a notice", |s| {
        s.snapshot().notices.iter().any(|notice| {
            notice.kind == NoticeKind::Error
                && notice.text.contains("broken.ply")
                && notice.text.contains("expected")
        })
    });
    let view = window.state().view();
    assert_eq!(view.comparison.model().unwrap().name, name(&window));
    assert_eq!(view.comparison.mode(), ViewMode::ModelWipe);
    wait(&mut window, "the end", |s| s.snapshot().state == RunState::Finished);
    assert_eq!(window.state().snapshot().frames_done, 40);
}

/// Opens a file or folder; unsaved training is discarded.
fn open(window: &mut Window, path: &Path) {
    drop_on(window, path);
    wait(window, "the opened path or a question", |s| {
        let snapshot = s.snapshot();
        snapshot.has_training_to_lose() || is_open(s, path)
    });
    if !is_open(window.state(), path) {
        click(window, "Discard");
    }
    wait(window, "the opened path", |s| is_open(s, path));
    window.run_steps(2);
}

fn is_open(studio: &Studio, path: &Path) -> bool {
    studio.snapshot().opened.as_ref().is_some_and(|opened| opened.path.as_deref() == Some(path))
}

#[test]
fn a_second_model_stays_beside_its_recording_and_leaves_with_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let [one, other] = ["one", "other"].map(|name| {
        let folder = folder.path().join(name);
        std::fs::create_dir(&folder).unwrap();
        dataset(&folder, 3)
    });
    let [file, saved] = ["green.ply", "one.vbgs"].map(|name| folder.path().join(name));
    green(&file);
    let Some(mut window) = window(Some(Subject::Path(one.clone())), Painting::Auto) else { return };
    train(&mut window);
    compare_with(&mut window, &file);
    wait(&mut window, "the model", |s| s.view().comparison.model().is_some());
    write_to(&mut window, Key::S, "Save", &saved);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let n_lost = |studio: &Studio| {
        let notices = studio.snapshot().notices.clone();
        notices.iter().filter(|n| n.text.contains("before retraining “room” is gone")).count()
    };
    // A checkpoint of the recording, and splats that may be of it.
    for path in [&saved, &file, &one] {
        open(&mut window, path);
        assert_eq!(name(&window), name_of(&file), "beside {}", path.display());
    }
    open(&mut window, &other);
    assert!(window.state().view().comparison.model().is_none(), "beside another recording");
    assert_eq!(n_lost(window.state()), 0, "it can be opened again");

    train(&mut window);
    // The figures move the button when they appear.
    wait(&mut window, "quality", |s| s.quality().result().is_some());
    click(&mut window, "Retrain finer");
    wait(&mut window, "the scene before", |s| s.view().comparison.model().is_some());
    wait(&mut window, "the end", |s| s.snapshot().state == RunState::Finished);
    open(&mut window, &one);
    assert!(window.state().view().comparison.model().is_none(), "the scene of another recording");
    wait(&mut window, "the notice", |s| n_lost(s) == 1);
}

/// Name of a second model from a file: that and its folder, shortened.
fn name_of(file: &Path) -> String {
    let folder = file.parent().unwrap().file_name().unwrap().to_string_lossy();
    format!("{folder}/green.ply")
}
