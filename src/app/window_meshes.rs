//! Conversion of the window's meshes to lists of triangles that update the stored image of the window
//! (`rendering.md`, Window on a software adapter).

use super::window_damage::{TextureChange, WindowDamage};
use crate::render::gpu::meshes::{
    MeshBatch, MeshKind, MeshList, MeshPainter, MeshVertex, PixelRect,
};
use eframe::egui::epaint::{ClippedPrimitive, Mesh, Primitive, Vertex, WHITE_UV};
use eframe::egui::{Color32, Pos2, Rect, TextureId, Vec2};
use std::sync::Arc;

/// Number of latest batches that a triangle may join.
const MAX_OPEN: usize = 8;

/// Output of egui after a pass.
#[derive(Debug)]
pub struct WindowPass {
    /// Meshes, back to front, without callbacks and with textures that egui manages only.
    pub primitives: Vec<ClippedPrimitive>,
    pub pixels_per_point: f32,
    /// Colour behind all meshes.
    pub background: Color32,
}

/// Window as drawn last.
#[derive(Debug)]
pub struct KeptWindow {
    /// Painter that holds the image.
    pub painter: MeshPainter,
    /// Pass that the image shows.
    shown: Option<Arc<WindowPass>>,
    /// Textures that have changed since then.
    changes: Vec<TextureChange>,
}

impl KeptWindow {
    pub fn new(painter: MeshPainter) -> Self {
        Self { painter, shown: None, changes: Vec::new() }
    }

    pub fn change(&mut self, change: TextureChange) {
        self.changes.push(change);
    }

    /// Discards the image: the next pass draws all of it.
    pub fn invalidate(&mut self) {
        self.shown = None;
        self.changes.clear();
    }

    /// Returns what to draw so that a window of `size` (columns, rows) shows `pass`.
    pub fn update_to_pass(&mut self, pass: &Arc<WindowPass>, size: [u32; 2]) -> MeshList {
        let before = self.shown.replace(pass.clone());
        let changes = std::mem::take(&mut self.changes);
        let comparable = before.filter(|before| {
            self.painter.size() == Some(size)
                && before.pixels_per_point == pass.pixels_per_point
                && before.background == pass.background
        });
        let whole = PixelRect { min: [0; 2], max: size };
        let places = match comparable {
            None => vec![whole],
            Some(before) => WindowDamage::between(&before.primitives, &pass.primitives, &changes)
                .regions()
                .iter()
                .map(|place| pixels(*place, pass.pixels_per_point, size))
                .collect(),
        };
        mesh_list(pass, size, &places)
    }
}

/// Returns every pixel that a region touches.
fn pixels(place: Rect, pixels_per_point: f32, size: [u32; 2]) -> PixelRect {
    // Casts saturate: positions left of the window or above it become 0.
    let (min, max) = (place.min * pixels_per_point, place.max * pixels_per_point);
    PixelRect {
        min: [(min.x.floor() as u32).min(size[0]), (min.y.floor() as u32).min(size[1])],
        max: [(max.x.ceil() as u32).min(size[0]), (max.y.ceil() as u32).min(size[1])],
    }
}

/// Scissor of egui's clip within a region, rounded like egui's own painter.
fn scissor(clip: Rect, pixels_per_point: f32, place: PixelRect) -> Option<PixelRect> {
    let (min, max) = (clip.min * pixels_per_point, clip.max * pixels_per_point);
    let inside = PixelRect {
        min: [place.min[0].max(min.x.round() as u32), place.min[1].max(min.y.round() as u32)],
        max: [place.max[0].min(max.x.round() as u32), place.max[1].min(max.y.round() as u32)],
    };
    (inside.min[0] < inside.max[0] && inside.min[1] < inside.max[1]).then_some(inside)
}

/// Batches all triangles of a pass that reach into the regions, over its background.
fn mesh_list(pass: &WindowPass, size: [u32; 2], places: &[PixelRect]) -> MeshList {
    let mut list = MeshList::default();
    for &place in places {
        let mut batches = Batches { list: &mut list, pass, size, place, open: Vec::new() };
        batches.fill();
        for ClippedPrimitive { clip_rect, primitive } in &pass.primitives {
            if let Primitive::Mesh(mesh) = primitive {
                batches.add(mesh, *clip_rect);
            }
        }
        batches.close();
    }
    list
}

/// Batches of triangles in one region. A triangle joins an earlier batch of its kind if it overlaps
/// nothing drawn since: labels and buttons alternate, and every change of the pipeline is expensive.
struct Batches<'a> {
    list: &'a mut MeshList,
    pass: &'a WindowPass,
    size: [u32; 2],
    place: PixelRect,
    open: Vec<OpenBatch>,
}

struct OpenBatch {
    kind: MeshKind,
    scissor: PixelRect,
    /// Bounds of its triangles, points.
    bounds: Rect,
    indices: Vec<u32>,
}

impl Batches<'_> {
    /// Adds the background of the region.
    fn fill(&mut self) {
        let points = self.points(self.place);
        let mut mesh = Mesh::default();
        mesh.add_colored_rect(points, self.pass.background);
        self.add(&mesh, points);
    }

    /// Adds the triangles of a mesh that reach into the region.
    fn add(&mut self, mesh: &Mesh, clip: Rect) {
        let scale = self.pass.pixels_per_point;
        let Some(scissor) = scissor(clip, scale, self.place) else { return };
        let inside = self.points(scissor);
        // Indices of the mesh's vertices in the list, once they are added.
        let mut places = Vec::new();
        for corners in mesh.indices.chunks_exact(3) {
            let corners = [corners[0], corners[1], corners[2]].map(|corner| corner as usize);
            let vertices = corners.map(|corner| mesh.vertices[corner]);
            let bounds = Rect::from_points(&vertices.map(|vertex| vertex.pos));
            if !inside.intersects(bounds) {
                continue;
            }
            places.resize(mesh.vertices.len(), u32::MAX);
            let indices = [0, 1, 2].map(|k| {
                let place = &mut places[corners[k]];
                if *place == u32::MAX {
                    *place = self.list.vertices.len() as u32;
                    self.list.vertices.push(corner(vertices[k], scale, self.size));
                }
                *place
            });
            // Most triangles end inside their clip: they need no scissor and share a batch with others.
            let is_whole = inside.contains_rect(bounds);
            let scissor = if is_whole { self.place } else { scissor };
            self.join(kind(mesh.texture_id, &vertices), scissor, bounds.intersect(inside), indices);
        }
    }

    fn join(&mut self, kind: MeshKind, scissor: PixelRect, bounds: Rect, indices: [u32; 3]) {
        for batch in self.open.iter_mut().rev().take(MAX_OPEN) {
            if batch.kind == kind && batch.scissor == scissor {
                batch.bounds = batch.bounds.union(bounds);
                batch.indices.extend(indices);
                return;
            }
            if batch.bounds.intersects(bounds) {
                break;
            }
        }
        self.open.push(OpenBatch { kind, scissor, bounds, indices: indices.to_vec() });
    }

    fn close(self) {
        for OpenBatch { kind, scissor, indices, .. } in self.open {
            let first = self.list.indices.len() as u32;
            self.list.indices.extend(indices);
            let indices = first..self.list.indices.len() as u32;
            self.list.batches.push(MeshBatch { kind, scissor, indices });
        }
    }

    fn points(&self, PixelRect { min, max }: PixelRect) -> Rect {
        let points = |[x, y]: [u32; 2]| {
            Pos2::ZERO + Vec2::new(x as f32, y as f32) / self.pass.pixels_per_point
        };
        Rect::from_min_max(points(min), points(max))
    }
}

/// Cheapest kind that draws a triangle.
fn kind(texture: TextureId, corners: &[Vertex; 3]) -> MeshKind {
    match texture {
        // Shapes without a texture use a white texel.
        TextureId::Managed(0) if corners.iter().all(|corner| corner.uv == WHITE_UV) => {
            let is_opaque = corners.iter().all(|corner| corner.color.is_opaque());
            if is_opaque { MeshKind::Opaque } else { MeshKind::Blended }
        }
        TextureId::Managed(key) | TextureId::User(key) => MeshKind::Textured(key),
    }
}

fn corner(vertex: Vertex, pixels_per_point: f32, size: [u32; 2]) -> MeshVertex {
    let Pos2 { x, y } = vertex.pos * pixels_per_point;
    MeshVertex {
        position: [2.0 * x / size[0] as f32 - 1.0, 1.0 - 2.0 * y / size[1] as f32],
        uv: vertex.uv.into(),
        color: vertex.color.to_array(),
    }
}
