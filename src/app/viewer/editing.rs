//! Edits in the viewport: selection rectangle, crop box, and the resulting changes for painters.

use super::SceneView;
use super::photo::PictureRequest;
use super::steering::ViewPosition;
use super::world_painter::WorldPainter;
use crate::app::edit::editor::Editor;
use crate::app::edit::marks::SelectMode;
use crate::app::edit::visible::slots_within;
use crate::app::palette::Palette;
use crate::app::splat_updates::SplatChange;
use crate::app::state::Opened;
use crate::math::camera::Camera;
use crate::model::attributes::ComponentAttributes;
use crate::render::Lens;
use crate::render::attributes::Attribute;
use eframe::egui::{Color32, PointerButton, Pos2, Rect, Response, Stroke, StrokeKind, Ui, Vec2};
use glam::{DVec2, DVec3};

const FRAME: Color32 = Color32::from_rgb(255, 90, 220);

impl SceneView {
    pub fn editor(&self) -> &Editor {
        &self.editor
    }

    /// Attributes of each splat, if colours, edits or panels need them.
    pub fn attributes(&self) -> &[ComponentAttributes] {
        self.palette.attributes()
    }

    pub fn editor_and_palette(&mut self) -> (&mut Editor, &Palette) {
        (&mut self.editor, &self.palette)
    }

    /// Attribute that the worker delivers with components: the displayed one, else evidence if a panel
    /// or the birth filter needs attributes.
    fn watched_attribute(&self) -> Option<Attribute> {
        let is_asked = self.editor.needs_attributes || self.editor.born_until().is_some();
        self.settings.color_mode.attribute().or(is_asked.then_some(Attribute::Evidence))
    }

    /// Returns the attribute to watch at the end of a pass. Panels renew their requests in the next
    /// pass.
    pub fn take_watched_attribute(&mut self) -> Option<Attribute> {
        let watched = self.watched_attribute();
        self.editor.needs_attributes = false;
        watched
    }

    pub(super) fn apply_colors_and_edits(&mut self) {
        self.palette.set_stores_attributes(self.watched_attribute().is_some());
        if let Some(change) = self.palette.set_attribute(self.settings.color_mode.attribute()) {
            self.pass_change_to_painter(change);
        }
        if let Some(change) = self.editor.update_visible(&self.palette) {
            self.painter.change(change, self.editor.displayed_splats(&self.palette));
        }
    }

    /// Passes a change of the palette to the painter, filtered by the edits.
    pub(super) fn pass_change_to_painter(&mut self, change: SplatChange) {
        if let Some(change) = self.editor.apply_change(change, &self.palette) {
            self.painter.change(change, self.editor.displayed_splats(&self.palette));
        }
    }

    /// True while a drag edits, so that it does not orbit the camera.
    pub(super) fn is_editing(&self) -> bool {
        self.edit_drag.is_some()
    }

    /// Starts an edit if a drag begins; handles of the crop box take precedence.
    pub(super) fn begin_edit(&mut self, ui: &Ui, response: &Response, opened: &Opened) {
        if !response.drag_started_by(PointerButton::Primary) {
            return;
        }
        let Some(at) = ui.input(|i| i.pointer.press_origin()) else { return };
        let face = self.crop_shown().and_then(|crop| {
            let world = self.world_of(ui, response.rect, &self.latest_camera?, opened)?;
            face_at(&world, crop, at)
        });
        // Edits apply to the current splats, which are not visible while the past is shown.
        let is_boxing = self.editor.is_box_selecting && self.editor.displayed_past().is_none();
        let selects = is_boxing.then_some(EditDrag::Select);
        self.edit_drag = face.map(EditDrag::Face).or(selects);
        if self.edit_drag.is_some() {
            // A guided camera must not move during the drag.
            self.guide = None;
        }
    }

    /// Draws the crop box and the selection rectangle, and applies the drag.
    pub(super) fn update_edit_drag(
        &mut self,
        ui: &Ui,
        response: &Response,
        request: &PictureRequest,
        opened: &Opened,
    ) {
        let world = self.world_of(ui, response.rect, &request.camera, opened);
        if let (Some(crop), Some(world)) = (self.crop_shown(), &world) {
            draw(world, crop);
        }
        match self.edit_drag {
            None => return,
            Some(EditDrag::Select) => self.drag_box(ui, response, request),
            Some(EditDrag::Face(face)) => {
                if let (Some(crop), Some(world)) = (self.editor.edits().crop(), &world) {
                    let crop = drag_face(world, crop, face, response.drag_delta());
                    let next = self.editor.edits().with_crop(Some(crop));
                    self.editor.log.drag(next);
                }
            }
        }
        if !response.dragged_by(PointerButton::Primary) {
            self.editor.log.end_drag();
            self.edit_drag = None;
        }
    }

    fn drag_box(&mut self, ui: &Ui, response: &Response, request: &PictureRequest) {
        let ends = ui.input(|i| i.pointer.press_origin().zip(i.pointer.latest_pos()));
        if let Some((from, to)) = ends {
            let frame = Rect::from_two_pos(from, to).intersect(response.rect);
            let painter = ui.painter().with_clip_rect(response.rect);
            painter.rect_filled(frame, 0.0, FRAME.gamma_multiply(0.15));
            painter.rect_stroke(frame, 0.0, Stroke::new(1.5, FRAME), StrokeKind::Inside);
            self.latest_box = Some(frame);
        }
        if !response.drag_stopped_by(PointerButton::Primary) {
            return;
        }
        let Some(frame) = self.latest_box.take() else { return };
        let pixel = |at: Pos2| {
            let at = (at - response.rect.min) * ui.ctx().pixels_per_point();
            DVec2::new(at.x.into(), at.y.into())
        };
        let corners = [frame.min, frame.max].map(pixel);
        let (lens, near) = (request.options.method.lens(), request.options.near);
        let slots = slots_within(self.palette.learned(), &request.camera, lens, near, corners);
        let how = match ui.input(|i| i.modifiers) {
            modifiers if modifiers.command => SelectMode::Remove,
            modifiers if modifiers.shift => SelectMode::Add,
            _ => SelectMode::Replace,
        };
        self.editor.select(slots, &self.palette, how);
    }

    /// Crop box, while its panel is open.
    fn crop_shown(&self) -> Option<[DVec3; 2]> {
        self.editor.edits().crop().filter(|_| self.editor.needs_attributes)
    }

    /// `None` for a fisheye, which bends straight lines.
    fn world_of(
        &self,
        ui: &Ui,
        rect: Rect,
        camera: &Camera,
        opened: &Opened,
    ) -> Option<WorldPainter> {
        let is_pinhole = self.place != ViewPosition::Free || self.settings.lens == Lens::Pinhole;
        is_pinhole.then(|| WorldPainter::new(ui, rect, camera, opened.home.radius))
    }
}

/// Edit made by a drag in the viewport, instead of orbiting the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EditDrag {
    Select,
    /// Moves a face of the crop box. The index is twice the axis, plus one for the far face.
    Face(usize),
}

const EDGE: Color32 = Color32::from_rgb(120, 220, 255);
/// Radius of a handle and of its grab area, points.
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
        world.painter().circle(at, HANDLE, EDGE, Stroke::new(1.5, Color32::BLACK));
    }
}

/// Returns the face whose handle is at a window position.
fn face_at(world: &WorldPainter, crop: [DVec3; 2], at: Pos2) -> Option<usize> {
    let distance =
        |(face, centre): (usize, DVec3)| Some((world.position(centre)?.distance(at), face));
    let all = face_centres(crop).into_iter().enumerate().filter_map(distance);
    let nearest = all.min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.filter(|(distance, _)| *distance <= GRIP).map(|(_, face)| face)
}

/// Returns the box with one face moved along its axis by a drag of `by` points, at most to the opposite
/// face.
fn drag_face(world: &WorldPainter, crop: [DVec3; 2], face: usize, by: Vec2) -> [DVec3; 2] {
    let (axis, at) = (face / 2, face_centres(crop)[face]);
    // A small step along the axis gives its direction and scale on screen.
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
