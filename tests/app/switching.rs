//! Opening datasets and files one after another, from every kind of camera position.

use super::harness::{Window, dataset, drag, drop_on, menu, wait, window};
use super::viewer::{choose, press};
use crate::common::adapter::turn;
use eframe::egui::{Key, PointerButton};
use egui_kittest::kittest::Queryable;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use vbgs_studio::app::state::{RunState, Subject};
use vbgs_studio::app::viewer::toolbar::ViewMode;
use vbgs_studio::app::{Painting, Studio};
use vbgs_studio::dataset::synthetic::SyntheticParams;
use vbgs_studio::dataset::synthetic::write::{SyntheticLayout, write};
use vbgs_studio::dataset::{self, LoadOptions};
use vbgs_studio::export::{ModelFormat, WriteOptions};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::Session;
use vbgs_studio::pipeline::settings::scene::SceneOverrides;

/// Camera positions: at the dataset's last camera in one comparison mode of each kind, and elsewhere.
const STANDS: [Stand; 5] = [
    Stand::Free,
    Stand::At(ViewMode::Wipe),
    Stand::At(ViewMode::PhotoWipe),
    Stand::At(ViewMode::Preparation),
    Stand::Left,
];

#[derive(Clone, Copy, Debug)]
enum Stand {
    /// Moved by the user; no camera of the dataset was visited.
    Free,
    /// At the last camera, in this view mode.
    At(ViewMode),
    /// Turned away from the last camera.
    Left,
}

/// Writes a dataset with a single split, fewer splits and frames than the others.
fn one_split(folder: &Path) -> PathBuf {
    let path = folder.join("kitchen");
    let params = SyntheticParams {
        width: 64,
        height: 48,
        n_train: 2,
        n_eval: 0,
        seed: 2,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    write(&params, &path, SyntheticLayout::SevenScenes, &mut |_, _| {}).unwrap();
    path
}

/// The demo and a file of every kind, each with its number of cameras.
fn subjects(folder: &Path) -> Vec<(Subject, usize)> {
    let room = dataset(folder, 3);
    let kitchen = one_split(folder);
    let model = folder.join("model.ply");
    let splat = Splat { opacity: 0.9, scale: [0.2; 3], ..Splat::default() };
    vbgs_studio::export::write(&model, &[splat], &WriteOptions::new(ModelFormat::Ply)).unwrap();
    let run = folder.join("run.vbgs");
    let opened = Arc::new(dataset::open(&room, &LoadOptions::default()).unwrap());
    let mut session =
        Session::new(opened, SceneOverrides::default(), Selection::all_frames()).unwrap();
    session.step().unwrap();
    session.save(&run).unwrap();
    let demo = SyntheticParams::demo();
    vec![
        (Subject::Demo, demo.n_train + demo.n_eval),
        (Subject::Path(room), 4),
        (Subject::Path(kitchen), 2),
        (Subject::Path(model), 0),
        (Subject::Path(run), 4),
    ]
}

/// Cyclic sequence of the numbers below `n` in which every ordered pair occurs, equal numbers included.
fn every_pair(n: usize) -> Vec<usize> {
    let round = (0..n).flat_map(|a| [a].into_iter().chain((a + 1..n).flat_map(move |b| [a, b])));
    round.chain([0]).collect()
}

fn serial(studio: &Studio) -> u64 {
    studio.snapshot().opened.as_ref().map_or(0, |opened| opened.serial)
}

/// Opens a subject and draws every pass until it is loaded.
fn open(window: &mut Window, subject: &Subject) {
    let before = serial(window.state());
    match subject {
        Subject::Demo => menu(window, "Open", "Demo"),
        Subject::Path(path) => drop_on(window, path),
    }
    let is_open = |s: &Studio| serial(s) > before && s.snapshot().state != RunState::Loading;
    wait(window, "something else", is_open);
    window.run_steps(2); // the snapshot may be newer than the last pass
    if *subject == Subject::Demo {
        press(window, Key::Space); // the demo trains at once, which only costs time here
    }
}

fn stand(window: &mut Window, stand: Stand) {
    match stand {
        Stand::Free => drag(window, PointerButton::Primary),
        Stand::At(mode) => {
            press(window, Key::ArrowLeft);
            let opened = window.state().snapshot().opened.clone().unwrap();
            let lens = window.state().view().settings.lens;
            if mode.unavailable_reason(lens, &opened, None).is_none() && mode != ViewMode::Single {
                choose(window, 0, mode.label());
                assert_eq!(window.state().view().comparison.mode(), mode);
            }
        }
        Stand::Left => {
            press(window, Key::ArrowLeft);
            drag(window, PointerButton::Primary);
        }
    }
}

#[test]
fn no_camera_outlives_its_dataset() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subjects = subjects(folder.path());
    assert_eq!(every_pair(2), [0, 0, 1, 1, 0]);
    for chosen in STANDS {
        let Some(mut window) = window(None, Painting::Auto) else { return };
        window.run_steps(2);
        for i in every_pair(subjects.len()) {
            let (subject, n_cameras) = &subjects[i];
            open(&mut window, subject);
            let view = window.state().view();
            let at_home = (view.camera.frame_ref(), view.comparison.mode());
            assert_eq!(at_home, (None, ViewMode::Single), "{chosen:?} {subject:?}");
            stand(&mut window, chosen);
            let label = window.query_by_label_contains("Camera ");
            let is_there = matches!(chosen, Stand::At(_)) && *n_cameras > 0;
            assert_eq!(label.is_some(), is_there, "{chosen:?} {subject:?}");
            if is_there {
                window.get_by_label(&format!("Camera {n_cameras} of {n_cameras}"));
            }
        }
        let snapshot = window.state().snapshot();
        let errors: Vec<_> = snapshot.notices.iter().filter(|n| n.text.contains("crash")).collect();
        assert!(errors.is_empty(), "{errors:?}");
    }
}
