//! Names in letters that the window's own fonts lack.

use super::harness::{PATIENCE, Window, dataset, device, is, studio, wait};
use crate::common::adapter::turn;
use eframe::egui::{FontFamily, FontId, Vec2};
use egui_kittest::Harness;
use std::path::Path;
use std::time::{Duration, Instant};
use vbgs_studio::app::Painting;
use vbgs_studio::app::state::{NoticeKind, RunState, Subject};

/// Opens a dataset in a window that may draw boxes in place of letters, as the program's does.
fn open(path: &Path) -> Option<Window> {
    let subject = Some(Subject::Path(path.to_owned()));
    let harness = Harness::builder().with_size(Vec2::new(1000.0, 640.0)).allow_missing_glyphs();
    let harness = harness.with_max_steps(8).wgpu_setup(device()?);
    Some(harness.build_eframe(move |cc| studio(cc, subject, Painting::Auto)))
}

/// Number of fonts that the window has loaded.
fn n_fonts(window: &Window) -> usize {
    window.ctx.fonts(|fonts| fonts.definitions().font_data.len())
}

#[test]
fn names_of_other_scripts_get_a_font_of_the_system_and_unknown_letters_a_notice() {
    let _turn = turn();
    let folder = tempfile::tempdir().unwrap();
    let path = dataset(folder.path(), 1);
    // The window's own fonts have Greek and Cyrillic; the last name has a letter that no font has.
    let [greek, hebrew, nobodys] =
        ["δωμάτιο комната", "חדר غرفة", "room \u{10FFFD}"].map(|name| folder.path().join(name));
    std::fs::rename(&path, &greek).unwrap();
    let Some(mut window) = open(&greek) else { return };
    wait(&mut window, "the first name", is(RunState::Ready));
    window.run_steps(5);
    let own = n_fonts(&window);
    drop(window);

    std::fs::rename(&greek, &hebrew).unwrap();
    let mut window = open(&hebrew).unwrap();
    let started = Instant::now();
    while n_fonts(&window) == own {
        assert!(started.elapsed() < PATIENCE, "no font is loaded: is DejaVu installed?");
        window.step();
        std::thread::sleep(Duration::from_millis(10));
    }
    window.run_steps(2);
    for family in [FontFamily::Proportional, FontFamily::Monospace] {
        let font = FontId::new(14.0, family);
        let has = window.ctx.fonts_mut(|fonts| fonts.has_glyphs(&font, "חדרغرفة"));
        assert!(has, "{font:?}");
    }
    assert!(n_fonts(&window) <= own + 2, "{} fonts", n_fonts(&window) - own);
    assert!(window.state().snapshot().notices.is_empty(), "nothing is lacking");
    drop(window);

    std::fs::rename(&hebrew, &nobodys).unwrap();
    let mut window = open(&nobodys).unwrap();
    wait(&mut window, "the notice", |studio| {
        let notices = &studio.snapshot().notices;
        notices.iter().any(|n| n.kind == NoticeKind::Info && n.text.contains("U+10FFFD"))
    });
    assert_eq!(n_fonts(&window), own);
}
