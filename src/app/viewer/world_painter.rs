//! Lines and pictures in world coordinates, drawn over the picture of the scene.
//!
//! egui draws them, not the renderers: they are few, they must be crisp, and the renderers must remain
//! what `eval` measures. Splats do not occlude them.

use crate::math::camera::Camera;
use eframe::egui::{Color32, Mesh, Painter, Pos2, Rect, Shape, Stroke, TextureId, Ui, Vec2};
use glam::{DMat3, DVec3};

/// Near plane, as a share of the scene's radius.
const NEAR: f64 = 1e-3;
/// Side of the square that marks a point, window points.
const POINT: f32 = 2.0;
/// Subdivisions of a picture along each side, because egui's triangles lack perspective correction.
const PIECES: usize = 4;

/// Draws shapes given in world coordinates into the viewport.
pub struct WorldPainter {
    painter: Painter,
    /// Rotation from world to camera.
    rotation: DMat3,
    translation: DVec3,
    focal: [f64; 2],
    centre: [f64; 2],
    origin: Pos2,
    points_per_pixel: f32,
    near: f64,
}

impl WorldPainter {
    /// Creates a painter over `rect` for a pinhole camera with the size of `rect` in pixels; `radius`
    /// is the scene's, world units.
    pub fn new(ui: &Ui, rect: Rect, camera: &Camera, radius: f64) -> Self {
        let (rotation, translation) = camera.pose.inverse();
        let k = &camera.intrinsics;
        Self {
            painter: ui.painter().with_clip_rect(rect),
            rotation,
            translation,
            focal: [k.fx, k.fy],
            centre: [k.cx, k.cy],
            origin: rect.min,
            points_per_pixel: 1.0 / ui.ctx().pixels_per_point(),
            near: NEAR * radius,
        }
    }

    /// egui's painter, clipped to the viewport.
    pub fn painter(&self) -> &Painter {
        &self.painter
    }

    /// Projects a world point to window points; `None` behind the near plane.
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

    /// Draws small squares at points, each in its colour.
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

    /// Draws a picture on a parallelogram given by its upper left, upper right and lower left corners.
    /// Draws nothing if a part of it is behind the camera.
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

    fn in_camera(&self, world: DVec3) -> DVec3 {
        self.rotation * world + self.translation
    }

    fn on_screen(&self, p: DVec3) -> Pos2 {
        let [fx, fy] = self.focal;
        let [cx, cy] = self.centre;
        let pixel = Pos2::new((fx * p.x / p.z + cx) as f32, (fy * p.y / p.z + cy) as f32);
        (pixel.to_vec2() * self.points_per_pixel).to_pos2() + self.origin.to_vec2()
    }
}
