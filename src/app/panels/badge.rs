//! The mark of a setting that differs from its default.

use eframe::egui::{Color32, Role, Sense, Ui, Vec2, WidgetInfo};

/// Room that is kept where there is no mark, so that nothing moves when one comes, points.
const SIZE: Vec2 = Vec2::splat(12.0);

/// Draws a dot if the setting `name` differs from what it is by `default`; whether a click takes it back.
pub fn ui(name: &str, default: &str, differs: bool, ui: &mut Ui) -> bool {
    if !differs {
        ui.allocate_exact_size(SIZE, Sense::hover());
        return false;
    }
    let (rect, response) = ui.allocate_exact_size(SIZE, Sense::click());
    let is_hot = response.hovered() || response.has_focus();
    let dot = ui.visuals().selection.bg_fill.lerp_to_gamma(Color32::WHITE, 0.25);
    ui.painter().circle_filled(rect.center(), if is_hot { 5.0 } else { 3.5 }, dot);
    let text = format!("{name}: back to {default}");
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &text));
    response.on_hover_text(format!("Changed. Click: {text}")).clicked()
}
