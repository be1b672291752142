//! Helpers shared by panels of controls and texts.

use eframe::egui::{Label, Response, RichText, Ui};

pub const SLIDER: f32 = 200.0;

/// Sets the accessible name of a control whose visible label is elsewhere.
pub fn named(control: Response, name: &str) -> Response {
    control.ctx.accesskit_node_builder(control.id, |node| node.set_label(name));
    control
}

/// Adds an explanation in weak text.
pub fn weak(ui: &mut Ui, text: &str) {
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}
