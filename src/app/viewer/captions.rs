//! Captions over the picture: names of the compared pictures, PSNR, hints.

use super::photo::{ComparedPicture, Partner, PhotoResult, PictureRequest};
use super::toolbar::ViewMode;
use super::{SceneView, measure};
use crate::app::command::UiCommand;
use crate::app::fonts::icon;
use crate::app::panels::controls::named;
use crate::render::compare::Combination;
use eframe::egui::{
    Align2, Button, Color32, CursorIcon, EventFilter, FontId, Id, Key, Label, Pos2, Rect, RichText,
    Sense, Stroke, Ui, Vec2, WidgetInfo,
};

impl SceneView {
    pub(super) fn draw_captions(
        &mut self,
        ui: &mut Ui,
        rect: Rect,
        request: &PictureRequest,
        photo: Option<&Result<PhotoResult, String>>,
    ) {
        let inner = rect.shrink(MARGIN);
        if let Some(second) = &request.second {
            let at = |share: [f32; 2]| rect.lerp_inside(Vec2::from(share));
            let compared = Rect::from_min_max(at(second.area.min), at(second.area.max));
            if let Combination::Wipe(_) = second.how
                && divider(ui, rect, compared, &mut self.comparison.divider)
            {
                // The CPU renders at low resolution until the divider rests.
                self.camera.note_movement();
            }
            self.captions(ui, inner.intersect(compared.shrink(MARGIN)), second);
        }
        let known = photo.and_then(|photo| photo.as_ref().ok());
        // Legend and PSNR share a corner: a photograph with painted pixels is not measured.
        if let Some(pixel_counts) = known.and_then(|photo| photo.pixel_counts) {
            measure::legend(&pixel_counts, inner.right_bottom(), ui);
        }
        if let Some(psnr) = known.and_then(|photo| photo.psnr) {
            let [r, g, b] = self.settings.background;
            let tooltip = format!(
                "Whole photograph at its native size, as measured by `vbgs-studio eval --background #{r:02x}{g:02x}{b:02x}`"
            );
            let other = known.and_then(|photo| photo.compared_psnr).zip(self.comparison.model());
            let other = other.map(|(psnr, model)| format!(" · {} {psnr:.2} dB", model.name));
            let text = format!("PSNR {psnr:.2} dB{}", other.unwrap_or_default());
            plate(ui, inner.right_bottom(), Align2::RIGHT_BOTTOM, &text, &tooltip);
        }
        if let Some(text) = self.hint_now(ui, photo) {
            plate(ui, inner.center_bottom(), Align2::CENTER_BOTTOM, &text, "");
        }
    }

    fn captions(&self, ui: &mut Ui, inner: Rect, second: &ComparedPicture) {
        let is_difference = matches!(second.how, Combination::Difference(_));
        let (left, right) = match &second.partner {
            Partner::Splats(_) if is_difference => ("Projected", "exact"),
            Partner::Splats(_) => ("Projected", "Exact"),
            Partner::Model(model, _) => ("Scene", model.name.as_str()),
            Partner::Photo(_) if is_difference => ("Scene", "photograph"),
            Partner::Photo(_) if self.comparison.mode() == ViewMode::Preparation => {
                ("Scene", "Preparation")
            }
            Partner::Photo(_) => ("Scene", "Photograph"),
        };
        if is_difference {
            // Rounded as in the toolbar.
            let gain = self.settings.difference_gain.round();
            let text = format!("|{left} − {right}| × {gain}");
            plate(ui, inner.left_top(), Align2::LEFT_TOP, &text, "");
        } else {
            plate(ui, inner.left_top(), Align2::LEFT_TOP, left, "");
            plate(ui, inner.right_top(), Align2::RIGHT_TOP, right, "");
        }
    }

    fn hint_now(&self, ui: &Ui, photo: Option<&Result<PhotoResult, String>>) -> Option<String> {
        // First, because this error also explains why no comparison is drawn.
        if let Some(Err(problem)) = photo {
            return Some(problem.clone());
        }
        if let Some(text) = self.overlays.hint(ui) {
            return Some(text.to_owned());
        }
        if let Some(past) = self.editor.displayed_past() {
            return Some(format!(
                "Scene after frame {} of {} (Edit)",
                past.after.n_seen, self.n_frames
            ));
        }
        if self.editor.is_box_selecting {
            return Some("Box select: drag over splats (B to exit)".to_owned());
        }
        if let Some(hint) = self.overlays.measure.hint() {
            return Some(hint.to_owned());
        }
        let is_away = self.comparison.mode().needs_frame() && self.camera.is_free();
        is_away.then(|| "No photograph from this viewpoint: press [ or ] to go to one".to_owned())
    }
}

/// Offset of the button's centre from the upper right corner of the viewport, and its size, points.
const GUIDE: Vec2 = Vec2::new(-46.0, 140.0);
const GUIDE_SIZE: Vec2 = Vec2::new(30.0, 24.0);

impl SceneView {
    /// Draws the button that makes the view follow the frame in training.
    pub(super) fn guide_button(&mut self, ui: &mut Ui, rect: Rect) {
        let command = UiCommand::AutoCamera;
        let place = Rect::from_center_size(rect.right_top() + GUIDE, GUIDE_SIZE);
        let button = ui.put(place, Button::new(icon::FOLLOW).selected(self.camera.is_guided()));
        let hint = format!("{}: {}", command.label(), command.hint(ui.ctx()));
        if named(button, command.label()).on_hover_text(hint).clicked() {
            self.camera.toggle_guide();
        }
    }
}

/// Width of the draggable area around the divider, points.
// Wider than the line, which would be hard to hit.
const GRIP: f32 = 14.0;
/// Distance that an arrow key moves the divider, as a fraction of the viewport's width.
const STEP: f32 = 0.02;
/// Distance of captions from the edge of the viewport, points.
const MARGIN: f32 = 10.0;

/// Draws a draggable divider over the compared part of the viewport. Returns true while it is dragged.
/// `divider` is its position as a fraction of the whole viewport's width.
fn divider(ui: &Ui, viewport: Rect, compared: Rect, divider: &mut f32) -> bool {
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
    // A dark rim keeps the white line visible on bright pictures.
    painter.vline(x, compared.y_range(), Stroke::new(3.0, Color32::from_black_alpha(140)));
    painter.vline(x, compared.y_range(), Stroke::new(1.0, Color32::WHITE));
    let knob = Pos2::new(x, compared.center().y);
    // With focus too: then the arrow keys move it.
    let is_hot = response.hovered() || response.dragged() || response.has_focus();
    let fill = if is_hot { Color32::WHITE } else { Color32::from_gray(210) };
    painter.circle(knob, 7.0, fill, Stroke::new(1.0, Color32::from_black_alpha(160)));
    response.dragged()
}

/// Draws a line of text on a dark plate. The corner or edge `anchor` of the plate is at `at`. An empty
/// tooltip is not shown.
fn plate(ui: &mut Ui, at: Pos2, anchor: Align2, text: &str, tooltip: &str) {
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
