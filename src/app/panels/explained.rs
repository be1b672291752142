//! What panels of controls and texts have in common.

use eframe::egui::{Label, RichText, Ui};

/// Width of the sliders, points.
pub const SLIDER: f32 = 200.0;

/// A text that explains what is above it.
pub fn weak(ui: &mut Ui, text: &str) {
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}
