//! Picking, the Inspector, colour modes, adapters, and a lost device.

use super::harness::{
    PATIENCE, Window, clear_view, dataset, settled, step, studio, train, wait, wait_for_label,
    window,
};
use super::viewer::choose;
use crate::common::adapter::{turn, vulkan};
use eframe::egui::{Event, Key, Modifiers, PointerButton, Pos2, Vec2};
use egui_kittest::Harness;
use egui_kittest::kittest::Queryable;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Instant;
use vbgs_studio::app::color_mode::ColorMode;
use vbgs_studio::app::drawing::ViewRenderer;
use vbgs_studio::app::state::{Inspected, RunState, Subject};
use vbgs_studio::app::wording;
use vbgs_studio::app::{ExitReason, Painting, Studio};
use vbgs_studio::export::{ModelFormat, WriteOptions};
use vbgs_studio::model::splat::splats::Splat;

/// Middle of the viewport.
pub const MIDDLE: Pos2 = Pos2::new(325.0, 340.0);

/// Opens the window on a device of its own, for tests that destroy it; `None` without a Vulkan adapter
/// outside strict mode.
fn window_and_device(subject: Subject, painting: Painting) -> Option<(Window, wgpu::Device)> {
    vulkan()?;
    let device = Arc::new(Mutex::new(None));
    let found = device.clone();
    let harness = Harness::builder()
        .with_size(Vec2::new(1000.0, 640.0))
        .with_max_steps(8)
        .wgpu()
        .build_eframe(move |cc| {
            *found.lock().unwrap() = cc.wgpu_render_state.as_ref().map(|s| s.device.clone());
            studio(cc, Some(subject), painting)
        });
    let device = device.lock().unwrap().take().unwrap();
    Some((harness, device))
}

pub fn click_at(window: &mut Window, pos: Pos2) {
    let button = |pressed| Event::PointerButton {
        pos,
        button: PointerButton::Primary,
        pressed,
        modifiers: Modifiers::NONE,
    };
    window.event(Event::PointerMoved(pos));
    window.step();
    window.event(button(true));
    window.step();
    window.event(button(false));
    window.step();
}

/// Histogram of the colours in the middle of the picture.
fn colors(window: &mut Window) -> BTreeMap<[u8; 4], usize> {
    let image = window.render().unwrap();
    let mut colors = BTreeMap::new();
    for y in (200..440).step_by(3) {
        for x in (120..540).step_by(3) {
            *colors.entry(image.get_pixel(x, y).0).or_default() += 1;
        }
    }
    colors
}

#[test]
fn a_click_shows_the_posterior_and_escape_forgets_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let subject = Subject::Path(dataset(folder.path(), 3));
    let Some(mut window) = window(Some(subject), Painting::Auto) else { return };
    train(&mut window);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    clear_view(&mut window);
    click_at(&mut window, MIDDLE);
    wait(&mut window, "the selection", |s| s.snapshot().inspected.is_some());
    window.run_steps(2);
    let inspected = window.state().snapshot().inspected.clone().unwrap();
    let Inspected::Component(component) = &*inspected else { panic!("{inspected:?}") };
    assert!(component.posterior.count > 0.0 && component.weight > 0.0);
    assert!(component.posterior.alpha > component.posterior.count);
    window.get_by_label(&format!("Splat {}", component.id));
    for label in
        ["Mean", "Covariance", "Weight", "Points N", "κ", "ν", "α", "Born in frame", "Gradient rgb"]
    {
        window.get_by_label(label);
    }
    window.key_press(Key::Escape);
    wait(&mut window, "no selection", |s| s.snapshot().inspected.is_none());
    window.run_steps(2);
    window.get_by_label("Nothing is selected.");
}

#[test]
fn a_splat_of_a_file_is_picked_where_it_is_and_nothing_beside_it() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("three.ply");
    let splat = |x: f32| Splat {
        mean: [x, 0.0, 0.0],
        opacity: 0.9,
        color: [0.8, 0.3, 0.2],
        scale: [0.2; 3],
        ..Splat::default()
    };
    let splats = [splat(-3.0), splat(0.0), splat(3.0)];
    vbgs_studio::export::write(&file, &splats, &WriteOptions::new(ModelFormat::Ply)).unwrap();
    let Some(mut window) = window(Some(Subject::Path(file)), Painting::Auto) else { return };
    wait(&mut window, "splats", |s| s.n_drawn() == 3);
    click_at(&mut window, MIDDLE);
    wait(&mut window, "the selection", |s| s.snapshot().inspected.is_some());
    window.run_steps(2);
    let inspected = window.state().snapshot().inspected.clone().unwrap();
    assert_eq!(inspected.id(), 1);
    assert!(matches!(*inspected, Inspected::Splat { .. }));
    window.get_by_label("Splat 1");
    window.get_by_label("As stored in the file");
    assert!(window.query_by_label("Covariance").is_none(), "a file holds no posterior");
    let is_rim = |[r, g, b, _]: [u8; 4]| r > 220 && g < 130 && b > 180;
    let image = window.render().unwrap();
    let rim = image.pixels().filter(|pixel| is_rim(pixel.0)).count();
    assert!(rim > 50, "the rim of the selected splat is missing: {rim} pixels");
    click_at(&mut window, MIDDLE + Vec2::new(0.0, 200.0));
    wait(&mut window, "no selection", |s| s.snapshot().inspected.is_none());
}

#[test]
fn every_colour_that_stands_for_something_is_shown_with_its_legend() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 6);
    for painting in [Painting::Auto, Painting::Gpu] {
        let Some(mut window) = window(Some(Subject::Path(path.clone())), painting) else { return };
        wait(&mut window, "ready", |s| s.snapshot().state == RunState::Ready);
        let mut components = 0;
        for n in 1..=3 {
            step(&mut window);
            wait(&mut window, "a frame", |s| s.snapshot().frames_done == n);
            let now = window.state().snapshot().model.components;
            assert!(now > components, "{now} components after {components}");
            components = now;
            wait_for_label(&mut window, &wording::count(components, "splat"));
        }
        settled(&mut window);
        let own = colors(&mut window);
        for (mode, title) in [
            (ColorMode::Evidence, "Evidence, points"),
            (ColorMode::Uncertainty, "Uncertainty, world units"),
            (ColorMode::Birth, "Birth frame"),
            (ColorMode::Elbo, "Per-point ELBO, nats"),
        ] {
            choose_color(&mut window, mode);
            if mode == ColorMode::Elbo {
                window.run_steps(2);
                window.get_by_label("Available after the next trained frame");
                step(&mut window);
                wait(&mut window, "a frame", |s| s.snapshot().frames_done == 4);
            }
            let started = Instant::now();
            let unknown = "Available after the first trained frame";
            while window.query_by_label(unknown).is_some() || colors(&mut window) == own {
                assert!(started.elapsed() < PATIENCE, "{mode:?} {painting:?}");
                window.step();
            }
            window.get_all_by_label(title).next().unwrap();
        }
        choose_color(&mut window, ColorMode::Color);
        assert!(window.query_by_label("unknown").is_none());
    }
}

/// Chooses from the colour menu above the viewport.
fn choose_color(window: &mut Window, mode: ColorMode) {
    choose(window, 1, mode.label());
    window.run_steps(3);
}

#[test]
fn after_a_fault_the_cpu_draws_until_the_gpu_is_tried_again() {
    let _turn = turn();
    let Some((mut window, device)) = window_and_device(Subject::Demo, Painting::Gpu) else {
        return;
    };
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    let impossible = wgpu::BufferDescriptor {
        label: None,
        size: 3,
        usage: wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::MAP_WRITE,
        mapped_at_creation: true,
    };
    drop(device.create_buffer(&impossible));
    wait(&mut window, "the CPU", |s| s.view().painter.drawn.drawer == ViewRenderer::Cpu);
    let told = |s: &Studio| s.snapshot().notices.iter().any(|n| n.text.contains("CPU renderer is"));
    wait(&mut window, "a notice", told);
    window.get_by_label("Settings").click();
    window.run_steps(2);
    window.get_by_label("Graphics adapter");
    window.get_by_label("Choose automatically");
    // By accessibility action, since the button may lie below the visible part of the panel.
    window.get_by_label("Retry GPU").click_accesskit();
    wait(&mut window, "the GPU", |s| s.view().painter.drawn.drawer != ViewRenderer::Cpu);
    wait(&mut window, "splats", |s| s.n_drawn() > 100);
    assert_eq!(window.state().exit().reason.get(), ExitReason::Closed, "the window stays");
    window.run_steps(2);
    assert!(window.query_by_label("Retry GPU").is_none());
}
