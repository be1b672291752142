//! Camera control by pointer and keys.

use super::harness::{
    Window, dataset, drag, drag_between, drop_on, is, settled, train, turn_wheel, wait, window,
    write_to,
};
use super::inspect::MIDDLE;
use super::viewer::press;
use crate::common::adapter::turn;
use crate::common::shared;
use eframe::egui::{Key, PointerButton, Pos2, Vec2};
use glam::DVec3;
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{RunState, Source, Subject};
use vbgs_studio::export;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::model::splat::appearance::SplatView;
use vbgs_studio::render::cpu::CpuRenderer;
use vbgs_studio::render::{RenderMethod, RenderOptions};

#[test]
fn the_camera_follows_the_pointer_and_keys() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 2);
    let Some(mut window) = window(Some(Subject::Path(path)), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    window.key_press(Key::H);
    window.step();
    let home = settled(&mut window);
    drag(&mut window, PointerButton::Primary);
    let turned = settled(&mut window);
    assert_ne!(home, turned, "orbit");
    drag(&mut window, PointerButton::Secondary);
    let panned = settled(&mut window);
    assert_ne!(turned, panned, "pan");
    drag(&mut window, PointerButton::Middle);
    assert_ne!(panned, settled(&mut window), "pan by the middle button");
    let distance = |window: &Window| {
        let view = window.state().view();
        view.camera.eye().unwrap().distance(view.camera.target().unwrap())
    };
    let before = distance(&window);
    turn_wheel(&mut window, MIDDLE, 100.0);
    let near = distance(&window);
    assert!(near < 0.9 * before, "{before} → {near}");
    turn_wheel(&mut window, MIDDLE, -300.0);
    assert!(distance(&window) > 1.2 * before, "{before} → {}", distance(&window));
    window.key_press(Key::F);
    window.step();
    assert_ne!(panned, settled(&mut window), "frame");
    window.key_press(Key::H);
    window.step();
    assert_eq!(home, settled(&mut window), "home");
}

/// Width and height of the visible scene from the window's camera, as shares of the picture. Panics if the
/// scene touches the border.
fn seen_whole(window: &Window, splats: SplatView) -> [f64; 2] {
    let view = window.state().view();
    let [width, height] = view.camera.size_px;
    let stood = view.camera.keyframe().unwrap();
    let intrinsics = Intrinsics::from_vertical_fov(width, height, stood.fov_y);
    let camera = Camera { intrinsics, pose: stood.pose };
    let distance = stood.pose.centre().distance(view.camera.target().unwrap());
    let options = RenderOptions::viewport(RenderMethod::PROJECTED, [0.0; 3], distance);
    let picture = CpuRenderer::default().render(splats, &camera, &options);
    let seen = picture.coverage.data.iter().enumerate().filter(|(_, share)| **share > 0.02);
    let seen: Vec<[usize; 2]> =
        seen.map(|(i, _)| [i % width as usize, i / width as usize]).collect();
    [0, 1].map(|axis| {
        let size = [width, height][axis] as usize;
        let at = seen.iter().map(|pixel| pixel[axis]);
        let (first, last) = (at.clone().min().unwrap(), at.max().unwrap());
        assert!(first > 0 && last + 1 < size, "{first} to {last} of {size} along {axis}");
        (last - first) as f64 / size as f64
    })
}

#[test]
fn f_shows_the_whole_scene_and_fills_the_smaller_side() {
    let _turn = turn();
    let Some(lego) = shared("data/lego400") else { return };
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("lego.ply");
    let Some(mut window) = window(Some(Subject::Path(lego)), Painting::Auto) else { return };
    train(&mut window);
    write_to(&mut window, Key::E, "Export", &file);
    wait(&mut window, "the file", |s| s.snapshot().files.unsaved_frames == 0);
    let lego = export::read(&file).unwrap().splats;
    for source in [Source::Dataset, Source::Model] {
        for size in [[1000.0, 640.0], [1700.0, 500.0], [700.0, 1300.0]] {
            window.set_size(Vec2::from(size));
            window.run_steps(3);
            // Home fixes the viewing direction, on which the filled share depends.
            press(&mut window, Key::H);
            drag(&mut window, PointerButton::Primary);
            drag(&mut window, PointerButton::Secondary);
            press(&mut window, Key::F);
            let filled = seen_whole(&window, lego.view());
            let most = filled[0].max(filled[1]);
            assert!(most > 0.5, "{source:?}, {size:?}: {filled:?}");
        }
        drop_on(&mut window, &file);
        wait(&mut window, "the model", |s| s.snapshot().source == Source::Model);
        wait(&mut window, "shown", is(RunState::Finished));
    }
}

#[test]
fn f_turns_to_the_side_that_the_cameras_saw() {
    let _turn = turn();
    let Some(recording) = shared("data/open3d_sample") else { return };
    let Some(mut window) = window(Some(Subject::Path(recording)), Painting::Auto) else { return };
    train(&mut window);
    let cameras: Vec<DVec3> = {
        let opened = window.state().snapshot().opened.clone().unwrap();
        let frames =
            &opened.dataset.as_ref().unwrap().splits[opened.plan.as_ref().unwrap().split].frames;
        frames.iter().map(|frame| frame.camera.pose.forward()).collect()
    };
    let forward = |window: &mut Window| {
        window.run_steps(2);
        window.state().view().camera.keyframe().unwrap().pose.forward()
    };
    let nearest = |ahead: DVec3| cameras.iter().map(|own| own.dot(ahead)).fold(-1.0, f64::max);
    // A seen direction is kept.
    press(&mut window, Key::H);
    let before = forward(&mut window);
    assert!(nearest(before) > 0.99, "{}", nearest(before));
    press(&mut window, Key::F);
    assert!(forward(&mut window).distance(before) < 1e-6);
    // From behind, F turns around.
    let start = Pos2::new(300.0, 300.0);
    for _ in 0..40 {
        if nearest(forward(&mut window)) < -0.2 {
            break;
        }
        drag_between(&mut window, PointerButton::Primary, start, start + Vec2::new(30.0, 0.0));
    }
    assert!(nearest(forward(&mut window)) < -0.2, "{}", nearest(forward(&mut window)));
    press(&mut window, Key::F);
    assert!(nearest(forward(&mut window)) > 0.9, "{}", nearest(forward(&mut window)));
}
