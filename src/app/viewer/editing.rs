//! Edits by dragging in the viewport: selection rectangle and crop box.

use super::photo::PictureRequest;
use super::world_painter::WorldPainter;
use crate::app::edit::editor::Editor;
use crate::app::edit::marks::SelectMode;
use crate::app::edit::visible::slots_within;
use crate::app::palette::Palette;
use eframe::egui::{Color32, PointerButton, Pos2, Rect, Response, Stroke, StrokeKind, Ui, Vec2};
use glam::{DVec2, DVec3};

const FRAME: Color32 = Color32::from_rgb(255, 90, 220);

/// Edit that a drag in the viewport makes instead of orbiting the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum EditDrag {
    Select,
    /// Moves a face of the crop box. The index is twice the axis, plus 1 for the face with the larger
    /// coordinate.
    Face(usize),
}

#[derive(Default)]
pub(super) struct EditTool {
    drag: Option<EditDrag>,
    /// Selection rectangle of the latest egui pass.
    // egui clears the start of a drag in the pass that ends it.
    latest_box: Option<Rect>,
}

impl EditTool {
    pub(super) fn is_active(&self) -> bool {
        self.drag.is_some()
    }

    /// Starts an edit if a drag begins. Handles of the crop box take precedence. `world` paints with the
    /// camera of the latest picture.
    pub(super) fn begin(
        &mut self,
        ui: &Ui,
        response: &Response,
        editor: &Editor,
        world: Option<WorldPainter>,
    ) {
        if !response.drag_started_by(PointerButton::Primary) {
            return;
        }
        let Some(at) = ui.input(|i| i.pointer.press_origin()) else { return };
        let face = crop_shown(editor).and_then(|crop| face_at(world.as_ref()?, crop, at));
        // Edits apply to the current splats, which are not visible while the past is shown.
        let is_boxing = editor.is_box_selecting && editor.displayed_past().is_none();
        let selects = is_boxing.then_some(EditDrag::Select);
        self.drag = face.map(EditDrag::Face).or(selects);
    }

    /// Draws the crop box and the selection rectangle, and applies the drag. `world` is `None` for a
    /// fisheye, which bends straight lines.
    pub(super) fn update(
        &mut self,
        ui: &Ui,
        response: &Response,
        (request, world): (&PictureRequest, Option<&WorldPainter>),
        editor: &mut Editor,
        palette: &Palette,
    ) {
        if let (Some(crop), Some(world)) = (crop_shown(editor), world) {
            draw(world, crop);
        }
        match self.drag {
            None => return,
            Some(EditDrag::Select) => {
                if let Some(frame) = self.drag_box(ui, response) {
                    select(ui, response, request, frame, editor, palette);
                }
            }
            Some(EditDrag::Face(face)) => {
                if let (Some(crop), Some(world)) = (editor.edits().crop(), world) {
                    let crop = drag_face(world, crop, face, response.drag_delta());
                    let next = editor.edits().with_crop(Some(crop));
                    editor.log.drag(next);
                }
            }
        }
        if !response.dragged_by(PointerButton::Primary) {
            // The whole drag becomes one undo step.
            editor.log.end_drag();
            self.drag = None;
        }
    }

    /// Draws the selection rectangle. Returns it once the drag has ended.
    fn drag_box(&mut self, ui: &Ui, response: &Response) -> Option<Rect> {
        let ends = ui.input(|i| i.pointer.press_origin().zip(i.pointer.latest_pos()));
        if let Some((from, to)) = ends {
            let frame = Rect::from_two_pos(from, to).intersect(response.rect);
            let painter = ui.painter().with_clip_rect(response.rect);
            painter.rect_filled(frame, 0.0, FRAME.gamma_multiply(0.15));
            painter.rect_stroke(frame, 0.0, Stroke::new(1.5, FRAME), StrokeKind::Inside);
            self.latest_box = Some(frame);
        }
        if response.drag_stopped_by(PointerButton::Primary) { self.latest_box.take() } else { None }
    }
}

fn select(
    ui: &Ui,
    response: &Response,
    request: &PictureRequest,
    frame: Rect,
    editor: &mut Editor,
    palette: &Palette,
) {
    // The camera counts pixels, egui points.
    let corners = [frame.min, frame.max].map(|at| {
        let at = (at - response.rect.min) * ui.ctx().pixels_per_point();
        DVec2::new(at.x.into(), at.y.into())
    });
    let (lens, near) = (request.options.method.lens(), request.options.near);
    let slots = slots_within(palette.learned(), &request.camera, lens, near, corners);
    let how = match ui.input(|i| i.modifiers) {
        modifiers if modifiers.command => SelectMode::Remove,
        modifiers if modifiers.shift => SelectMode::Add,
        _ => SelectMode::Replace,
    };
    editor.select(slots, palette, how);
}

/// Returns the crop box while the edit panel is open.
fn crop_shown(editor: &Editor) -> Option<[DVec3; 2]> {
    editor.edits().crop().filter(|_| editor.shows_crop)
}

const EDGE: Color32 = Color32::from_rgb(120, 220, 255);
/// Radius of a handle as drawn, and radius of the area in which it can be dragged, points.
// The grab area is larger, so that a handle is easy to hit.
const HANDLE: f32 = 6.0;
const GRIP: f32 = 12.0;

fn face_centres(crop: [DVec3; 2]) -> [DVec3; 6] {
    std::array::from_fn(|face| {
        let mut at = 0.5 * (crop[0] + crop[1]);
        at[face / 2] = crop[face % 2][face / 2];
        at
    })
}

fn draw(world: &WorldPainter, crop: [DVec3; 2]) {
    let corner =
        |bits: usize| DVec3::from_array(std::array::from_fn(|axis| crop[bits >> axis & 1][axis]));
    for bits in 0..8 {
        for axis in (0..3).filter(|axis| bits >> axis & 1 == 0) {
            let ends = [corner(bits), corner(bits | 1 << axis)];
            world.line(ends, Stroke::new(1.5, EDGE));
        }
    }
    for at in face_centres(crop).into_iter().filter_map(|centre| world.position(centre)) {
        world.painter.circle(at, HANDLE, EDGE, Stroke::new(1.5, Color32::BLACK));
    }
}

/// Returns the face of the crop box whose handle is at a window position. For the index, see
/// [`EditDrag::Face`].
fn face_at(world: &WorldPainter, crop: [DVec3; 2], at: Pos2) -> Option<usize> {
    let distance =
        |(face, centre): (usize, DVec3)| Some((world.position(centre)?.distance(at), face));
    let all = face_centres(crop).into_iter().enumerate().filter_map(distance);
    let nearest = all.min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.filter(|(distance, _)| *distance <= GRIP).map(|(_, face)| face)
}

/// Returns the crop box with one face moved along its axis by a drag of `by` points. The face stops at
/// the opposite face.
fn drag_face(world: &WorldPainter, crop: [DVec3; 2], face: usize, by: Vec2) -> [DVec3; 2] {
    let (axis, at) = (face / 2, face_centres(crop)[face]);
    // A small step along the axis gives its direction and scale on screen. A box without extent still
    // needs a positive one.
    let step = 1e-3 * (crop[1] - crop[0]).max_element().max(f64::MIN_POSITIVE);
    let ends = [at, at + step * DVec3::AXES[axis]].map(|end| world.position(end));
    let [Some(from), Some(to)] = ends else { return crop };
    let along = (to - from) / step as f32;
    // Viewed end-on, the axis has no direction on screen.
    if along.length_sq() < f32::MIN_POSITIVE {
        return crop;
    }
    let by = f64::from(by.dot(along) / along.length_sq());
    let [mut low, mut high] = crop;
    match face.is_multiple_of(2) {
        true => low[axis] = (low[axis] + by).min(high[axis]),
        false => high[axis] = (high[axis] + by).max(low[axis]),
    }
    [low, high]
}
