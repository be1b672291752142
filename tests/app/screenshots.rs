//! Screenshots of the window: those of README, and every panel in both themes and several sizes for review.
//!
//! `VBGS_SCREENSHOTS=screenshots cargo test --release --test app -- --ignored pictures_of_readme` renews
//! README's; `VBGS_SCREENSHOTS=/tmp/panels … -- --ignored pictures_of_every_panel` writes the panels. Without
//! the variable, a small run only checks that every screenshot can be made and is not blank.

use super::harness::{
    PATIENCE, Window, click, close_notice, dataset, drop_on, enter_path, is, train, turn_wheel,
    wait, wait_for_picture, window,
};
use super::inspect::click_at;
use super::viewer::{choose, press};
use crate::common::adapter::turn;
use crate::common::shared;
use eframe::egui::{Event, Key, Modifiers, Pos2, Theme, Vec2, pos2};
use egui_kittest::kittest::Queryable;
use image::RgbaImage;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::imageops;
use std::collections::BTreeSet;
use std::fs::File;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::RunState;

/// Window size of README's screenshots.
const README_SIZE: Vec2 = Vec2::new(1280.0, 800.0);
const TABS: [&str; 7] = ["Summary", "Quality", "Latency", "Inspector", "Edit", "Path", "Settings"];
/// Window sizes for the panels: width and height in points, and pixels per point.
const SIZES: [(f32, f32, f32); 3] =
    [(800.0, 600.0, 1.0), (1600.0, 1000.0, 1.0), (1920.0, 1080.0, 2.0)];

/// Datasets for the screenshots and the folder they are written to.
struct Album {
    folder: PathBuf,
    is_kept: bool,
    /// Temporary folder, used if screenshots are not retained.
    own: tempfile::TempDir,
}

impl Album {
    fn new() -> Self {
        let own = tempfile::tempdir().unwrap();
        let asked = std::env::var_os("VBGS_SCREENSHOTS").map(PathBuf::from);
        let is_kept = asked.is_some();
        Self { folder: asked.unwrap_or_else(|| own.path().join("pictures")), is_kept, own }
    }

    /// Returns a recording, or a small synthetic one if screenshots are not retained.
    fn recording(&self, name: &str) -> Option<PathBuf> {
        if self.is_kept {
            return shared(name);
        }
        let folder = self.own.path().join(name);
        std::fs::create_dir_all(&folder).unwrap();
        Some(dataset(&folder, 3))
    }

    fn sizes(&self) -> &'static [(f32, f32, f32)] {
        if self.is_kept { &SIZES } else { &SIZES[..1] }
    }

    fn themes(&self) -> &'static [Theme] {
        if self.is_kept { &[Theme::Dark, Theme::Light] } else { &[Theme::Light] }
    }

    /// Writes a screenshot; panics if it is blank.
    fn save(&self, image: &RgbaImage, name: &str) {
        let colors: BTreeSet<[u8; 4]> = image.pixels().step_by(7).map(|pixel| pixel.0).collect();
        assert!(colors.len() > 30, "{name} has {} colours", colors.len());
        std::fs::create_dir_all(&self.folder).unwrap();
        let file = File::create(self.folder.join(name)).unwrap();
        let encoder =
            PngEncoder::new_with_quality(file, CompressionType::Best, FilterType::Adaptive);
        let opaque = image::DynamicImage::ImageRgba8(image.clone()).into_rgb8();
        opaque.write_with_encoder(encoder).unwrap();
    }
}

fn opened(dataset: Option<&Path>, size: Vec2) -> Option<Window> {
    let mut window = window(None, Painting::Auto)?;
    window.set_size(size);
    window.ctx.set_theme(Theme::Dark);
    window.run_steps(3);
    if let Some(dataset) = dataset {
        drop_on(&mut window, dataset);
    }
    Some(window)
}

/// Sets the scale before the size, since egui changes the size with the scale.
fn resize(window: &mut Window, size: Vec2, scale: f32) {
    window.set_pixels_per_point(scale);
    window.run_steps(2);
    window.set_size(size);
    window.run_steps(4);
}

/// Height of the status line, points.
const STATUS: f32 = 30.0;

/// Returns the window's picture once it no longer changes, except for the memory in the status line.
fn still(window: &mut Window) -> RgbaImage {
    // Without a pointer there is neither a highlighted button nor a tooltip.
    window.event(Event::PointerGone);
    let started = Instant::now();
    let mut last = RgbaImage::new(1, 1);
    loop {
        for _ in 0..20 {
            window.step();
            std::thread::sleep(Duration::from_millis(10));
        }
        let image = window.render().unwrap();
        let status = image.height() - (STATUS * window.ctx.pixels_per_point()) as u32;
        let differing = image.enumerate_pixels().zip(last.pixels());
        let at =
            differing.filter(|((_, _, now), before)| now != before).map(|((x, y, _), _)| (x, y));
        let at: Vec<(u32, u32)> = at.filter(|(_, y)| *y < status).collect();
        if at.is_empty() && image.dimensions() == last.dimensions() {
            return image;
        }
        assert!(
            started.elapsed() < PATIENCE,
            "the window never rests: {:?} {:?}",
            at.first(),
            at.last()
        );
        last = image;
    }
}

fn smaller(image: &RgbaImage, numerator: u32, denominator: u32) -> RgbaImage {
    let [width, height] = [image.width(), image.height()].map(|n| n * numerator / denominator);
    imageops::resize(image, width, height, imageops::FilterType::Lanczos3)
}

/// Closes the card shown after training and all notices.
fn close_all(window: &mut Window) {
    window.run_steps(2);
    while window.query_all_by_label("×").next().is_some() {
        close_notice(window);
    }
}

/// Selects a splat at a position, or the nearest one below it.
fn select(window: &mut Window, at: Pos2) {
    for step in 0..20 {
        click_at(window, at + Vec2::new(0.0, 8.0 * step as f32));
        // A click that hits no splat changes nothing, so the wait is bounded.
        for _ in 0..20 {
            window.step();
            if window.state().snapshot().inspected.is_some() {
                return;
            }
            std::thread::sleep(Duration::from_millis(10));
        }
    }
    panic!("no splat from {at} downwards");
}

#[test]
#[ignore = "trains the demo, and Lego and a Kinect recording if screenshots are retained"]
fn pictures_of_readme() {
    let _turn = turn();
    let album = Album::new();
    let recordings = ["data/lego400", "data/kinect_office"].map(|name| album.recording(name));
    let [Some(lego), Some(kinect)] = recordings else { return };
    let Some(mut window) = opened(None, README_SIZE) else { return };
    click(&mut window, "Try the synthetic scene");
    // Pausing before the first frame would leave the scene empty.
    wait(&mut window, "a frame", |s| s.snapshot().frames_done > 0);
    if is(RunState::Training)(window.state()) {
        window.key_press(Key::Space);
    }
    demo(&mut window, &album);

    let Some(mut window) = opened(Some(&lego), README_SIZE) else { return };
    train(&mut window);
    wait_for_picture(&mut window);
    close_all(&mut window);
    turn_wheel(&mut window, pos2(440.0, 330.0), -80.0);
    choose(&mut window, 1, "Evidence");
    select(&mut window, pos2(440.0, 360.0));
    album.save(&still(&mut window), "evidence-inspector.png");

    let Some(mut window) = opened(Some(&kinect), README_SIZE) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    click(&mut window, "Quality");
    train(&mut window);
    wait(&mut window, "the result", |s| s.quality().result().is_some());
    close_all(&mut window);
    press(&mut window, Key::G);
    window.run_steps(10);
    album.save(&still(&mut window), "kinect-room-dark.png");
    window.ctx.set_theme(Theme::Light);
    album.save(&smaller(&still(&mut window), 5, 8), "kinect-room-light.png");
}

/// Saves the demo after one frame beside its end, and the wipe between the renderers.
fn demo(window: &mut Window, album: &Album) {
    wait(window, "a frame", |s| s.snapshot().frames_done > 0 && s.n_drawn() > 100);
    let halves = [still(window), {
        if !is(RunState::Finished)(window.state()) {
            window.key_press(Key::Space);
        }
        wait(window, "the end", is(RunState::Finished));
        close_all(window);
        still(window)
    }];
    let halves = halves.map(|half| smaller(&half, 9, 16));
    let (width, height) = halves[0].dimensions();
    let mut both = RgbaImage::new(2 * width, height);
    for (half, x) in halves.iter().zip([0, width]) {
        imageops::replace(&mut both, half, x.into(), 0);
    }
    album.save(&both, "demo-growing.png");
    choose(window, 0, "Wipe renderers");
    album.save(&still(window), "wipe.png");
}

#[test]
#[ignore = "draws every panel, about eighty screenshots if they are retained"]
fn pictures_of_every_panel() {
    let _turn = turn();
    let album = Album::new();
    let Some(kinect) = album.recording("data/kinect_office") else { return };
    for &theme in album.themes() {
        let Some(mut window) = opened(None, README_SIZE) else { return };
        window.ctx.set_theme(theme);
        in_all_sizes(&mut window, &album, theme, "start", |_| ());
    }
    let Some(mut window) = opened(Some(&kinect), README_SIZE) else { return };
    wait(&mut window, "ready", is(RunState::Ready));
    for &theme in album.themes() {
        window.ctx.set_theme(theme);
        in_all_sizes(&mut window, &album, theme, "ready", |_| ());
    }
    resize(&mut window, README_SIZE, 1.0);
    train(&mut window);
    wait_for_picture(&mut window);
    for &theme in album.themes() {
        window.ctx.set_theme(theme);
        in_all_sizes(&mut window, &album, theme, "end", |_| ());
    }
    close_all(&mut window);
    resize(&mut window, README_SIZE, 1.0);
    select(&mut window, pos2(440.0, 330.0));
    for &theme in album.themes() {
        window.ctx.set_theme(theme);
        panels(&mut window, &album, theme);
    }
}

fn panels(window: &mut Window, album: &Album, theme: Theme) {
    for tab in TABS {
        in_all_sizes(window, album, theme, tab, |window| click(window, tab));
    }
    in_all_sizes(window, album, theme, "wipe", |window| {
        if !window.state().view().comparison.mode().has_photo() {
            press(window, Key::G);
        }
    });
    press(window, Key::G);
    in_all_sizes(window, album, theme, "help", |window| press(window, Key::F1));
    in_all_sizes(window, album, theme, "palette", |window| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::P);
        window.run_steps(2);
    });
    in_all_sizes(window, album, theme, "menu", |window| click(window, "View"));
    let file = album.folder.join("scene.ply");
    in_all_sizes(window, album, theme, "export", |window| {
        window.key_press_modifiers(Modifiers::COMMAND, Key::E);
        window.run_steps(2);
        enter_path(window, &file);
    });
}

/// Saves a screenshot of what `show` opens in every size; Escape closes overlays.
fn in_all_sizes(
    window: &mut Window,
    album: &Album,
    theme: Theme,
    name: &str,
    show: impl Fn(&mut Window),
) {
    for &(width, height, scale) in album.sizes() {
        resize(window, Vec2::new(width, height), scale);
        show(window);
        let theme = if theme == Theme::Dark { "dark" } else { "light" };
        album.save(&still(window), &format!("{name}-{theme}-{width}.png"));
        if matches!(name, "help" | "palette" | "menu" | "export") {
            press(window, Key::Escape);
            window.run_steps(2);
        }
    }
}
