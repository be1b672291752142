//! What panels of controls and texts have in common.

use eframe::egui::{Label, Response, RichText, Ui};

/// Width of the sliders, points.
pub const SLIDER: f32 = 200.0;

/// Names a control for those who do not see what stands beside it.
pub fn named(control: Response, name: &str) -> Response {
    control.ctx.accesskit_node_builder(control.id, |node| node.set_label(name));
    control
}

/// A text that explains what is above it.
pub fn weak(ui: &mut Ui, text: &str) {
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}
