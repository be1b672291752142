//! Background colour of the viewport.

use super::harness::{click, copied, window};
use crate::common::adapter::turn;
use eframe::egui::accesskit::Role;
use egui_kittest::kittest::Queryable;
use vbgs_studio::app::Painting;

/// The harness panics if a character has no glyph. The copy button of egui's colour picker is labelled with
/// an emoji, so the fonts must include it.
#[test]
fn any_colour_is_picked_and_copied() {
    let _turn = turn();
    let Some(mut window) = window(None, Painting::Auto) else { return };
    click(&mut window, "Settings");
    window.get_by_role_and_label(Role::ColorWell, "Any other colour").click();
    window.run_steps(5);
    assert_eq!(copied(&mut window, "\u{1f4cb}"), "23, 25, 31", "the dark background's colour");
}
