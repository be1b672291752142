//! Overlays of the picture: the divider of a wipe, and captions.

use eframe::egui::{
    Align2, Color32, CursorIcon, EventFilter, FontId, Id, Key, Label, Pos2, Rect, RichText, Sense,
    Stroke, Ui, Vec2, WidgetInfo,
};

/// Width of the divider's grab area, points.
const GRIP: f32 = 14.0;
/// Step of an arrow key, as a share of the viewport's width.
const STEP: f32 = 0.02;
/// Distance of captions from the edge of the viewport, points.
pub const MARGIN: f32 = 10.0;

/// Draws a draggable divider over the compared part of the viewport. `divider` is a share of the whole
/// viewport's width. Returns true while it is dragged.
pub fn divider(ui: &Ui, viewport: Rect, compared: Rect, divider: &mut f32) -> bool {
    let x_of = |share: f32| viewport.left() + share * viewport.width();
    // Clamped where it is drawn, not where it is stored: a narrow photograph must not move the divider
    // permanently.
    let x = x_of(*divider).clamp(compared.left(), compared.right());
    let grip = Rect::from_center_size(
        Pos2::new(x, compared.center().y),
        Vec2::new(GRIP, compared.height()),
    );
    let response = ui
        .interact(grip, Id::unique("divider"), Sense::drag())
        .on_hover_and_drag_cursor(CursorIcon::ResizeHorizontal);
    if response.dragged()
        && let Some(pointer) = response.interact_pointer_pos()
    {
        let at = pointer.x.clamp(compared.left(), compared.right());
        *divider = (at - viewport.left()) / viewport.width();
    }
    response.widget_info(|| WidgetInfo::slider(true, (*divider).into(), "Divider"));
    if response.has_focus() {
        // Without this filter the arrow keys would move the focus.
        let kept = EventFilter { horizontal_arrows: true, ..EventFilter::default() };
        ui.memory_mut(|memory| memory.set_focus_lock_filter(response.id, kept));
        let pressed = |key| ui.input(|i| i.num_presses(key)) as f32;
        let steps = pressed(Key::ArrowRight) - pressed(Key::ArrowLeft);
        *divider = (*divider + STEP * steps).clamp(0.0, 1.0);
    }
    // Computed again after the drag, or the line would lag one pass behind the pointer.
    let x = x_of(*divider).clamp(compared.left(), compared.right());
    let painter = ui.painter();
    painter.vline(x, compared.y_range(), Stroke::new(3.0, Color32::from_black_alpha(140)));
    painter.vline(x, compared.y_range(), Stroke::new(1.0, Color32::WHITE));
    let knob = Pos2::new(x, compared.center().y);
    let is_hot = response.hovered() || response.dragged() || response.has_focus();
    let fill = if is_hot { Color32::WHITE } else { Color32::from_gray(210) };
    painter.circle(knob, 7.0, fill, Stroke::new(1.0, Color32::from_black_alpha(160)));
    response.dragged()
}

/// Draws a line of text on a dark plate anchored at `at`; with a tooltip unless that is empty.
pub fn plate(ui: &mut Ui, at: Pos2, anchor: Align2, text: &str, tooltip: &str) {
    let font = FontId::proportional(13.0);
    let size = ui.painter().layout_no_wrap(text.to_owned(), font.clone(), Color32::WHITE).size();
    let rect = anchor.anchor_size(at, size + Vec2::new(16.0, 8.0));
    ui.painter().rect_filled(rect, 4.0, Color32::from_black_alpha(170));
    // Selectable text would capture drags meant for the camera.
    let label = Label::new(RichText::new(text).font(font).color(Color32::WHITE)).selectable(false);
    let response = ui.put(rect, label);
    if !tooltip.is_empty() {
        response.on_hover_text(tooltip);
    }
}
