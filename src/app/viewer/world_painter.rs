//! Lines and pictures in world coordinates, drawn over the picture of the scene.
//!
//! egui draws them instead of the renderers: they are few and must be crisp, and `eval` measures the
//! renderers without overlays. Splats do not occlude them.

use super::viewpoint::Viewpoint;
use crate::math::camera::{Camera, Intrinsics};
use eframe::egui::{
    Align2, Color32, FontId, Id, Mesh, Painter, Pos2, Rect, Role, Sense, Shape, Stroke, TextureId,
    Ui, Vec2, WidgetInfo,
};
use glam::{DMat3, DVec3};

/// Distance of the near plane, as a fraction of the scene's radius.
const NEAR: f64 = 1e-3;
const POINT: f32 = 2.0;
/// Number of subdivisions of a picture along each side.
// egui's triangles lack perspective correction.
const PIECES: usize = 4;

pub struct WorldPainter {
    pub(super) painter: Painter,
    rotation: DMat3,
    translation: DVec3,
    intrinsics: Intrinsics,
    origin: Pos2,
    points_per_pixel: f32,
    near: f64,
}

impl WorldPainter {
    /// Creates a painter over `rect` for a pinhole camera whose image has the size of `rect` in pixels.
    /// `radius` is the scene's radius, world units.
    pub fn new(ui: &Ui, rect: Rect, camera: &Camera, radius: f64) -> Self {
        let (rotation, translation) = camera.pose.inverse();
        Self {
            painter: ui.painter().with_clip_rect(rect),
            rotation,
            translation,
            intrinsics: camera.intrinsics,
            origin: rect.min,
            points_per_pixel: 1.0 / ui.ctx().pixels_per_point(),
            near: NEAR * radius,
        }
    }

    /// Returns the centre of the camera, world coordinates.
    pub fn eye(&self) -> DVec3 {
        self.rotation.transpose() * -self.translation
    }

    /// Projects a point from world coordinates to window coordinates (points). `None` if the point is
    /// nearer to the camera than the near plane.
    pub fn position(&self, world: DVec3) -> Option<Pos2> {
        let p = self.in_camera(world);
        (p.z > self.near).then(|| self.on_screen(p))
    }

    /// Draws a line between two world points, clipped at the near plane.
    pub fn line(&self, ends: [DVec3; 2], stroke: Stroke) {
        let [a, b] = ends.map(|end| self.in_camera(end));
        let cut = |behind: DVec3, ahead: DVec3| {
            let share = (self.near - behind.z) / (ahead.z - behind.z);
            behind + (ahead - behind) * share
        };
        let (a, b) = match (a.z > self.near, b.z > self.near) {
            (true, true) => (a, b),
            (true, false) => (a, cut(b, a)),
            (false, true) => (cut(a, b), b),
            (false, false) => return,
        };
        self.painter.line_segment([self.on_screen(a), self.on_screen(b)], stroke);
    }

    pub fn points(&self, points: &[(DVec3, Color32)]) {
        let mut mesh = Mesh::default();
        for &(point, color) in points {
            let Some(at) = self.position(point).filter(|at| self.painter.clip_rect().contains(*at))
            else {
                continue;
            };
            mesh.add_colored_rect(Rect::from_center_size(at, Vec2::splat(POINT)), color);
        }
        self.painter.add(Shape::mesh(mesh));
    }

    /// Draws a picture on a parallelogram, given by its upper left, upper right and lower left corners
    /// in world coordinates. Draws nothing if a part of it is behind the camera.
    pub fn picture(&self, [corner, right, down]: [DVec3; 3], texture: TextureId, tint: Color32) {
        let mut mesh = Mesh::with_texture(texture);
        for row in 0..=PIECES {
            for column in 0..=PIECES {
                let [u, v] = [column, row].map(|i| i as f64 / PIECES as f64);
                let Some(at) = self.position(corner + (right - corner) * u + (down - corner) * v)
                else {
                    return;
                };
                let uv = Pos2::new(u as f32, v as f32);
                mesh.vertices.push(eframe::egui::epaint::Vertex { pos: at, uv, color: tint });
            }
        }
        let stride = PIECES as u32 + 1;
        for row in 0..PIECES as u32 {
            for column in 0..PIECES as u32 {
                let first = row * stride + column;
                mesh.add_triangle(first, first + 1, first + stride);
                mesh.add_triangle(first + 1, first + stride, first + stride + 1);
            }
        }
        self.painter.add(Shape::mesh(mesh));
    }

    /// Draws the ground grid through the origin, and the axes. The cell size is the power of ten closest
    /// to a fifth of the scene's `radius` (world units).
    pub fn grid(&self, up: DVec3, radius: f64) {
        let cell = 10f64.powf((0.2 * radius).log10().round());
        let across = up.any_orthonormal_vector();
        let along = up.cross(across);
        let reach = f64::from(CELLS) * cell;
        for i in -CELLS..=CELLS {
            let offset = f64::from(i) * cell;
            for (a, b) in [(across, along), (along, across)] {
                // Every fifth line is stronger, so that cells can be counted.
                let stroke = Stroke::new(if i % 5 == 0 { 1.0 } else { 0.5 }, GRID);
                self.line([a * offset - b * reach, a * offset + b * reach], stroke);
            }
        }
        for (axis, _, color) in AXES {
            self.line([DVec3::ZERO, axis * cell * 5.0], Stroke::new(2.0, color));
        }
    }

    fn in_camera(&self, world: DVec3) -> DVec3 {
        self.rotation * world + self.translation
    }

    fn on_screen(&self, p: DVec3) -> Pos2 {
        let k = &self.intrinsics;
        let pixel = Pos2::new((k.fx * p.x / p.z + k.cx) as f32, (k.fy * p.y / p.z + k.cy) as f32);
        (pixel.to_vec2() * self.points_per_pixel).to_pos2() + self.origin.to_vec2()
    }
}

const AXES: [(DVec3, &str, Color32); 3] = [
    (DVec3::X, "X", Color32::from_rgb(230, 90, 90)),
    (DVec3::Y, "Y", Color32::from_rgb(110, 200, 110)),
    (DVec3::Z, "Z", Color32::from_rgb(100, 150, 240)),
];
/// Length of an arm of the gizmo, and offset of the gizmo from the viewport's upper right corner,
/// points.
const ARM: f32 = 26.0;
const PLACE: Vec2 = Vec2::new(-46.0, 84.0);
const KNOB: f32 = 8.0;
/// Cosine of the angle below which the view counts as being from an axis.
const NEARLY: f64 = 0.999;
const GRID: Color32 = Color32::from_gray(90);
/// Number of grid cells on each side of the origin.
const CELLS: i32 = 10;

impl Viewpoint {
    /// Draws the axis gizmo. A click on the end of an axis moves the camera onto that axis, a second click
    /// onto its opposite side. A right click makes the axis point up, and down if it
    /// points up.
    pub(super) fn gizmo(&mut self, ui: &Ui, rect: Rect) {
        let Some(from_world) = self.rotation_from_world() else { return };
        let centre = rect.right_top() + PLACE;
        let up = self.up();
        let mut ends = AXES.map(|(axis, name, color)| (axis, name, color, from_world * axis));
        // Far ends first, so that near ones cover them.
        ends.sort_by(|a, b| b.3.z.total_cmp(&a.3.z));
        let mut asked = None;
        for (axis, name, color, seen) in ends {
            let at = centre + Vec2::new(seen.x as f32, seen.y as f32) * ARM;
            let knob = Rect::from_center_size(at, Vec2::splat(2.0 * KNOB));
            let response = ui.interact(knob, Id::unique(("axis", name)), Sense::click());
            arm(ui, [centre, at], name, color, response.hovered());
            // Not 1: the up direction of a dataset need not be an axis.
            let note = if axis.dot(up) > 0.9 { " (up)" } else { "" };
            // From there already: the next click is for the opposite side.
            let is_there = seen.z < -NEARLY;
            let (side, sign) = if is_there { (-axis, "-") } else { (axis, "") };
            let name = format!("View from {sign}{name}");
            response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &name));
            let response = response
                .on_hover_text(format!("{name}{note}; right-click to make this axis point up"));
            if response.clicked() {
                asked = Some((side, false));
            } else if response.secondary_clicked() {
                let is_up = axis.dot(up) > NEARLY;
                asked = Some((if is_up { -axis } else { axis }, true));
            }
        }
        if let Some((axis, is_up)) = asked {
            self.apply_axis(axis, is_up);
        }
    }
}

fn arm(ui: &Ui, [from, to]: [Pos2; 2], name: &str, color: Color32, is_hovered: bool) {
    let painter = ui.painter();
    painter.line_segment([from, to], Stroke::new(2.0, color));
    let fill = if is_hovered { Color32::WHITE } else { color };
    painter.circle_filled(to, KNOB, fill);
    let font = FontId::proportional(11.0);
    painter.text(to, Align2::CENTER_CENTER, name, font, Color32::BLACK);
}
