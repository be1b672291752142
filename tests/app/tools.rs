//! Flying, setting the pivot, measuring, and overlays of the viewport.

use super::harness::{
    PATIENCE, Window, clear_view, click, dataset, drop_on, enter_path, is, menu, press_in_dialog,
    train, wait, wait_for_picture, wait_for_text, window, write_to,
};
use super::inspect::{MIDDLE, click_at};
use crate::common::adapter::turn;
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2, ViewportCommand, ViewportId};
use egui_kittest::kittest::Queryable;
use glam::DVec3;
use std::path::Path;
use std::time::Instant;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};

fn trained(folder: &Path) -> Option<Window> {
    let subject = Subject::Path(dataset(folder, 3));
    let mut window = window(Some(subject), Painting::Auto)?;
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    wait_for_picture(&mut window);
    Some(window)
}

fn hold(window: &mut Window, key: Key, pressed: bool, modifiers: Modifiers) {
    let event = Event::Key { key, physical_key: None, pressed, repeat: false, modifiers };
    window.event(event);
    window.step();
}

#[test]
fn keys_fly_and_with_ctrl_they_fly_slowly_instead_of_saving() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    let flown = |window: &mut Window, steps: usize| {
        let before = window.state().view().camera.eye().unwrap();
        (0..steps).for_each(|_| window.step());
        (window.state().view().camera.eye().unwrap() - before).length()
    };
    hold(&mut window, Key::W, true, Modifiers::NONE);
    let far = flown(&mut window, 4);
    assert!(far > 0.0 && !window.state().view().camera.is_guided());
    window.event(Event::ModifiersChanged(Modifiers::COMMAND));
    hold(&mut window, Key::S, true, Modifiers::COMMAND);
    hold(&mut window, Key::W, false, Modifiers::COMMAND);
    let slowly = flown(&mut window, 4);
    assert!(slowly > 0.0 && slowly < 0.2 * far, "{slowly} after {far}");
    assert!(window.query_by_label("Save checkpoint").is_none(), "Ctrl+S flies backwards now");
    hold(&mut window, Key::S, false, Modifiers::NONE);
    window.event(Event::ModifiersChanged(Modifiers::NONE));
    assert_eq!(flown(&mut window, 3), 0.0);
}

/// Clicks twice within one pass, since two passes of a test take nearly as long as egui's double-click
/// interval.
fn double_click_at(window: &mut Window, pos: Pos2) {
    window.event(Event::PointerMoved(pos));
    window.step();
    let button = |pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    window.input_mut().events.extend([true, false, true, false].map(button));
    window.step();
}

#[test]
fn a_double_click_turns_about_the_surface_where_it_is() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    clear_view(&mut window);
    let view = |window: &Window| {
        let view = window.state().view();
        (view.camera.eye().unwrap(), view.camera.target().unwrap())
    };
    let (eye, target) = view(&window);
    double_click_at(&mut window, MIDDLE + Vec2::new(-60.0, 40.0));
    wait(&mut window, "another pivot", |s| s.view().camera.target() != Some(target));
    let (stays, pivot) = view(&window);
    assert!((stays - eye).length() < 1e-9, "the camera turns without moving");
    // The pivot lies on the surface: another click at the middle finds about the same depth. It may hit
    // another of the coarse splats.
    double_click_at(&mut window, MIDDLE);
    wait(&mut window, "the same pivot", |s| s.view().camera.target() != Some(pivot));
    let (_, again) = view(&window);
    let distance = (pivot - eye).length();
    let apart = (again - pivot).length() / distance;
    assert!(apart < 0.2, "{pivot} and then {again}, {apart:.2} of the distance away");
}

#[test]
fn two_clicks_measure_with_a_standard_deviation() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    clear_view(&mut window);
    window.key_press(Key::M);
    window.run_steps(2);
    assert!(window.state().view().overlays.is_measuring());
    for (at, n) in [(MIDDLE, 1), (MIDDLE - Vec2::new(80.0, 30.0), 2)] {
        click_at(&mut window, at);
        wait(&mut window, "a place", |s| s.view().overlays.measure.n_ends() == n);
    }
    let measured = window.state().view().overlays.measure.length().unwrap();
    let deviation = measured.deviation.unwrap();
    assert!(measured.length > 0.0 && deviation > 0.0 && deviation < measured.length);
    window.key_press(Key::M);
    window.run_steps(2);
    assert!(!window.state().view().overlays.is_measuring());
}

#[test]
fn measured_points_set_the_coordinates_of_exports() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    let export = |window: &mut Window, name: &str| {
        let file = folder.path().join(name);
        write_to(window, Key::E, "Export", &file);
        wait(window, "the file", |s| {
            s.snapshot()
                .notices
                .iter()
                .any(|n| n.text.starts_with("Wrote ") && n.text.contains(name))
        });
        let splats = vbgs_studio::export::read(&file).unwrap().splats;
        splats.iter().map(|splat| DVec3::from_array(splat.mean.map(f64::from))).collect::<Vec<_>>()
    };
    let before = export(&mut window, "before.ply");
    clear_view(&mut window);
    window.key_press(Key::M);
    window.run_steps(2);
    let places = [MIDDLE, MIDDLE - Vec2::new(80.0, 30.0), MIDDLE + Vec2::new(60.0, -50.0)];
    let measure = |window: &mut Window, n: usize| {
        click_at(window, places[n - 1]);
        wait(window, "a place", |s| s.view().overlays.measure.n_ends() == n);
    };
    measure(&mut window, 1);
    measure(&mut window, 2);
    let length = window.state().view().overlays.measure.length().unwrap().length;
    window.get_by_label("Set scale").click();
    wait(&mut window, "a registration", |s| s.snapshot().registration.is_some());
    let files = window.state().snapshot().files.clone();
    assert_eq!((files.unsaved_frames, files.is_registration_unsaved), (0, true));
    assert!(window.state().snapshot().has_training_to_lose());
    let scale = window.state().snapshot().registration.as_ref().unwrap().scale;
    assert!((scale - 1.0 / length).abs() < 1e-9 * scale, "{scale}: {length}");
    measure(&mut window, 3);
    window.get_by_label("Set level").click();
    wait(&mut window, "a rotation", |s| {
        s.snapshot().registration.as_ref().is_some_and(|r| r.rotation[3] < 1.0 - 1e-9)
    });
    let registration = window.state().snapshot().registration.clone().unwrap();
    assert!((registration.scale - scale).abs() < 1e-9 * scale, "the scale stays");
    let after = export(&mut window, "after.ply");
    assert_eq!(before.len(), after.len());
    for (from, to) in before.iter().zip(&after) {
        assert!(registration.apply(*from).distance(*to) < 1e-4, "{from} {to}");
    }
    // A checkpoint holds it.
    let checkpoint = folder.path().join("registered.vbgs");
    write_to(&mut window, Key::S, "Save", &checkpoint);
    wait(&mut window, "the checkpoint", |_| checkpoint.exists());
    let saved = vbgs_studio::pipeline::checkpoint::SavedRun::read(&checkpoint).unwrap();
    assert_eq!(saved.meta.registration.as_ref(), Some(&*registration));
    window.get_by_label("Clear").click();
    wait(&mut window, "no registration", |s| s.snapshot().registration.is_none());
    assert_eq!(export(&mut window, "cleared.ply"), before);
}

#[test]
fn timings_are_written_beside_the_dataset_and_never_over_a_file() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    let wait_for_file = |window: &mut Window, name: String| {
        let file = folder.path().join(name);
        wait(window, "the notice", |s| {
            let words = format!("Wrote {}", file.display());
            s.snapshot().notices.iter().any(|n| n.kind == NoticeKind::Info && n.text == words)
        });
        file
    };
    click(&mut window, "Latency");
    window.get_by_label_contains("of frames within budget");
    for ending in ["", "-2"] {
        // By accessibility action, since the button may lie below the visible part of the panel.
        window.run_steps(2);
        window.get_by_label("Write CSV").click_accesskit();
        let file = wait_for_file(&mut window, format!("room.latency{ending}.csv"));
        let text = std::fs::read_to_string(&file).unwrap();
        assert!(text.starts_with("frame,points,load,prepare,"), "{text}");
        assert!(text.lines().count() > 3, "a line for each of three frames: {text}");
    }
}

#[test]
fn pictures_have_any_size_and_the_view_is_whole_in_them() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    let [width, height] = window.state().view().camera.size_px;
    let mut save = |name: &str, size: Option<&str>| {
        menu(&mut window, "Export", "Save picture");
        enter_path(&mut window, &folder.path().join("picture.jpg"));
        press_in_dialog(&mut window, "Save picture");
        wait_for_text(&mut window, "picture.jpg: expected a name that ends in .png");
        let file = folder.path().join(name);
        enter_path(&mut window, &file);
        if let Some(multiple) = size {
            window.get_by_label(multiple).click();
            window.run_steps(2);
        }
        press_in_dialog(&mut window, "Save picture");
        let words = format!("Wrote {}", file.display());
        wait(&mut window, "the notice", |s| s.snapshot().notices.iter().any(|n| n.text == words));
        image::open(&file).unwrap().into_rgb8()
    };
    let shown = save("shown.png", None);
    assert_eq!(shown.dimensions(), (width, height));
    let colors: std::collections::BTreeSet<[u8; 3]> = shown.pixels().map(|p| p.0).collect();
    assert!(colors.len() > 1000, "{} colours", colors.len());
    let large = save("large.png", Some("2×"));
    assert_eq!(large.dimensions(), (2 * width, 2 * height));
    // Four pixels of the large picture cover one of the shown picture.
    let apart: f64 = shown
        .enumerate_pixels()
        .map(|(x, y, pixel)| {
            let of = |channel: usize| {
                let block = [(0, 0), (1, 0), (0, 1), (1, 1)]
                    .map(|(i, j)| f64::from(large.get_pixel(2 * x + i, 2 * y + j)[channel]));
                (0.25 * block.iter().sum::<f64>() - f64::from(pixel[channel])).abs()
            };
            (0..3).map(of).sum::<f64>() / 3.0
        })
        .sum();
    let apart = apart / f64::from(width * height);
    assert!(apart < 3.0, "{apart} of 255 values apart");
}

#[test]
fn cameras_grid_and_points_of_the_current_frame_are_drawn_over_the_scene() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let Some(mut window) = trained(folder.path()) else { return };
    clear_view(&mut window);
    for key in [Key::C, Key::X] {
        let before = window.render().unwrap();
        window.key_press(key);
        window.run_steps(2);
        assert_ne!(before.as_raw(), window.render().unwrap().as_raw(), "{key:?}");
    }
    let settings = &window.state().view().settings;
    assert!(settings.shows_cameras && settings.shows_grid);
    let before = window.render().unwrap();
    assert_eq!(window.state().view().overlays.points_shown(), None);
    window.key_press(Key::P);
    wait(&mut window, "points", |s| s.view().overlays.points_shown().is_some_and(|(_, n)| n > 500));
    window.run_steps(2);
    let with = window.render().unwrap();
    assert_ne!(before.as_raw(), with.as_raw());
    // Viewing through a frame's camera shows that frame's points.
    let mut frames = Vec::new();
    for _ in 0..2 {
        window.key_press(Key::CloseBracket);
        window.run_steps(2);
        let looked_through = window.state().view().camera.frame_ref().unwrap().number();
        wait(&mut window, "those of another frame", |s| {
            s.view().overlays.points_shown().map(|(frame, _)| frame) == Some(looked_through)
        });
        frames.push(looked_through);
    }
    assert_ne!(frames[0], frames[1]);
    window.key_press(Key::P);
    window.run_steps(2);
    assert_eq!(window.state().view().overlays.points_shown(), None);
}

#[test]
fn the_title_names_what_is_open_and_recent_things_open_again() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| {
        std::fs::create_dir(folder.path().join(name)).unwrap();
        dataset(&folder.path().join(name), 2)
    });
    let Some(mut window) = window(None, Painting::Auto) else { return };
    let mut titles = Vec::new();
    for path in [&a, &b] {
        drop_on(&mut window, path);
        // Step by step, because each has its own commands.
        let started = Instant::now();
        let mut after = 0;
        while after < 3 {
            assert!(started.elapsed() < PATIENCE, "{} is not open", path.display());
            let opened = window.state().snapshot().opened.clone();
            after += usize::from(opened.is_some_and(|o| o.path.as_ref() == Some(path)));
            let commands = window.output().viewport_output.get(&ViewportId::ROOT);
            titles.extend(commands.into_iter().flat_map(|v| v.commands.clone()).filter_map(
                |command| match command {
                    ViewportCommand::Title(title) => Some(title),
                    _ => None,
                },
            ));
            window.step();
        }
    }
    assert!(titles.contains(&"room - VBGS Studio".to_owned()), "{titles:?}");
    click(&mut window, "Open");
    click(&mut window, "Recent");
    click(&mut window, &a.display().to_string());
    wait(&mut window, "the first again", |s| {
        s.snapshot().opened.as_ref().is_some_and(|o| o.path.as_ref() == Some(&a))
    });
    wait(&mut window, "ready", is(RunState::Ready));
}
