//! Dragging panels to other sides of the viewport.

use super::harness::{Window, click, drag_between, window};
use super::viewer::press;
use crate::common::adapter::turn;
use eframe::egui::{Key, PointerButton, Pos2};
use egui_kittest::kittest::Queryable;
use vbgs_studio::app::Painting;

fn tab(window: &Window, name: &str) -> Pos2 {
    window.get_by_label(name).rect().center()
}

fn drag_tab(window: &mut Window, name: &str, to: Pos2) {
    let from = tab(window, name);
    drag_between(window, PointerButton::Primary, from, to);
    window.run_steps(3);
}

#[test]
fn panels_are_dragged_beside_the_picture_and_put_back() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(3);
    let (scene, quality) = (tab(&window, "Summary"), tab(&window, "Quality"));
    assert_eq!(scene.y, quality.y);

    // Left of the viewport: both panels are visible.
    drag_tab(&mut window, "Summary", Pos2::new(12.0, 320.0));
    let moved = tab(&window, "Summary");
    assert!(moved.x < 200.0, "{moved:?}");
    assert!(tab(&window, "Quality").x > 600.0, "the others stay");
    window.get_by_label("Nothing is open.");
    click(&mut window, "Quality");
    window.get_by_label_contains("Quality is measured");
    window.get_by_label("Nothing is open.");

    // Below the neighbouring tabs.
    let settings = tab(&window, "Settings");
    drag_tab(&mut window, "Inspector", Pos2::new(settings.x, 560.0));
    let inspector = tab(&window, "Inspector");
    assert!(inspector.y > settings.y + 100.0, "{inspector:?} below {settings:?}");

    // A panel cannot be dropped on the viewport's middle, where it would hide the scene.
    let path = tab(&window, "Path");
    drag_tab(&mut window, "Path", Pos2::new(430.0, 320.0));
    assert_eq!(tab(&window, "Path"), path);
    window.get_by_label("Your own capture: drop a folder");

    click(&mut window, "View");
    window.get_by_label_contains("Reset layout").click();
    window.run_steps(3);
    for name in ["Summary", "Quality", "Latency", "Inspector", "Path", "Settings"] {
        assert_eq!(tab(&window, name).y, quality.y, "{name}");
    }
    assert_eq!(tab(&window, "Summary"), scene);
}

#[test]
fn a_window_of_any_size_has_its_panels() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    press(&mut window, Key::F6);
    let sizes = [[3840.0, 2160.0], [800.0, 600.0], [640.0, 400.0], [240.0, 60.0], [1000.0, 640.0]];
    for size in sizes {
        window.set_size(size.into());
        window.run_steps(3);
        window.render().unwrap();
    }
    window.run_steps(2);
    // The panel has its former width again.
    assert!(tab(&window, "Latency").x > 500.0);
}

#[test]
fn no_tab_hides_in_a_narrow_window() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    window.run_steps(3);
    let wide = window.get_by_label("Settings").rect().width();
    window.set_size([720.0, 460.0].into());
    // One pass detects the smaller size, the next one fits the tab names into it.
    window.run_steps(4);
    let settings = window.get_by_label("Settings").rect();
    // Names begin on whole pixels, so the last one may end up to a pixel late.
    assert!(settings.right() < 721.0 && settings.width() < wide, "{settings:?}");
}
