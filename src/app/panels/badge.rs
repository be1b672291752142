//! Marker of a setting that differs from its default.

use eframe::egui::{Color32, Role, Sense, Ui, Vec2, WidgetInfo};

/// Space reserved even without a marker, points, so that nothing moves when one appears.
const SIZE: Vec2 = Vec2::splat(12.0);

/// Draws a dot if the setting differs from its default; returns true if a click resets it.
pub fn ui(name: &str, default: &str, differs: bool, ui: &mut Ui) -> bool {
    if !differs {
        ui.allocate_exact_size(SIZE, Sense::hover());
        return false;
    }
    let (rect, response) = ui.allocate_exact_size(SIZE, Sense::click());
    let is_hot = response.hovered() || response.has_focus();
    let dot = ui.visuals().selection.bg_fill.lerp_to_gamma(Color32::WHITE, 0.25);
    ui.painter().circle_filled(rect.center(), if is_hot { 5.0 } else { 3.5 }, dot);
    let text = format!("{name}: reset to {default}");
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &text));
    response.on_hover_text(format!("Changed. Click to reset to {default}")).clicked()
}
