//! Draws the window in place of egui's painter if the graphics adapter computes on the CPU cores
//! (`rendering.md`, Window on a software adapter).
//!
//! After every pass, this painter takes egui's shapes and textures, and replaces the shapes by one callback
//! that draws them all. The window is stored as an image. Each pass is compared with the last one, and only
//! the regions that differ are drawn again. egui's painter still owns the textures and draws every pass
//! that this painter does not support.

use super::viewport;
use crate::render::gpu::meshes::{
    MeshBatch, MeshKind, MeshList, MeshPainter, MeshSampling, MeshVertex, PixelRect,
};
use eframe::egui::epaint::textures::{TextureFilter, TextureOptions, TextureWrapMode};
use eframe::egui::epaint::{
    ClippedPrimitive, ClippedShape, ImageData, ImageDelta, Mesh, Primitive, Vertex, WHITE_UV,
};
use eframe::egui::{
    Color32, Context, FullOutput, Plugin, Pos2, Rect, Shape, TextureId, Vec2, ViewportId,
};
use eframe::egui_wgpu::RenderState;
use std::collections::{BTreeSet, HashSet};
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};

pub struct WindowPainter {
    state: RenderState,
    window: Arc<Mutex<KeptWindow>>,
}

impl WindowPainter {
    /// Makes this painter draw the window of `context`, unless the window has an sRGB format.
    pub fn install(context: &Context, state: &RenderState) {
        // Windows with an sRGB format encode colours themselves: they are left to egui.
        if !state.target_format.is_srgb() {
            let painter = MeshPainter::new(&state.device, state.target_format);
            let window =
                KeptWindow { painter, shown: None, changes: Vec::new(), opaque: HashSet::new() };
            context.add_plugin(Self { state: state.clone(), window: Arc::new(Mutex::new(window)) });
        }
    }

    /// Passes changed texels to egui's renderer and records the changed area of the texture.
    fn update_texture(&self, window: &mut KeptWindow, id: TextureId, delta: &ImageDelta) {
        let ImageData::Color(image) = &delta.image;
        if !image.pixels.iter().all(Color32::is_opaque) {
            window.opaque.remove(&id);
        } else if delta.is_whole() {
            window.opaque.insert(id);
        }
        let RenderState { device, queue, renderer, .. } = &self.state;
        let mut renderer = renderer.write();
        renderer.update_texture(device, queue, id, delta);
        let Some(texture) = renderer.texture(&id).and_then(|there| there.texture.as_ref()) else {
            return;
        };
        let size = [texture.width() as f32, texture.height() as f32];
        let [x, y] = delta.pos.unwrap_or_default();
        let [width, height] = delta.image.size();
        let place = |x: usize, y: usize| Pos2::new(x as f32 / size[0], y as f32 / size[1]);
        let area = Rect::from_min_max(place(x, y), place(x + width, y + height));
        window.changes.push(TextureChange { id, area });
    }

    /// Binds the textures of an egui pass. Returns false if this painter cannot draw one of the primitives
    /// or their textures.
    fn bind_textures(&self, window: &mut KeptWindow, primitives: &[ClippedPrimitive]) -> bool {
        let mut ids = BTreeSet::new();
        for ClippedPrimitive { primitive, .. } in primitives {
            let Primitive::Mesh(Mesh { texture_id: TextureId::Managed(key), .. }) = primitive
            else {
                // Changes of callbacks and of user textures appear in no texture delta.
                return false;
            };
            ids.insert(*key);
        }
        window.painter.retain_textures(|key| ids.contains(&key));
        let renderer = self.state.renderer.read();
        ids.into_iter().all(|key| {
            let there = renderer.texture(&TextureId::Managed(key));
            let texture = there.and_then(|there| there.texture.as_ref());
            let sampling = there.and_then(|there| there.options).and_then(sampling);
            texture.zip(sampling).is_some_and(|(texture, sampling)| {
                window.painter.set_texture(&self.state.device, key, texture, sampling);
                true
            })
        })
    }
}

impl Plugin for WindowPainter {
    fn debug_name(&self) -> &'static str {
        "window painter"
    }

    fn output_hook(&mut self, context: &Context, output: &mut FullOutput) {
        // The kept image is that of the root window.
        if context.viewport_id() != ViewportId::ROOT {
            return;
        }
        let mut window = self.window.lock().unwrap_or_else(PoisonError::into_inner);
        // Here, because egui's painter would read them only after the pass.
        for (id, deltas) in output.textures_delta.set.drain() {
            deltas.iter().for_each(|delta| self.update_texture(&mut window, id, delta));
        }
        for id in &output.textures_delta.free {
            window.opaque.remove(id);
        }
        let shapes = std::mem::take(&mut output.shapes);
        let pixels_per_point = output.pixels_per_point;
        let primitives = context.tessellate(shapes, pixels_per_point);
        if !self.bind_textures(&mut window, &primitives) {
            // This pass does not reach the image, so the next one that does must draw all of it.
            window.shown = None;
            window.changes.clear();
            output.shapes = primitives.into_iter().map(shape).collect();
            return;
        }
        let background = context.global_style().visuals.panel_fill;
        let pass = Arc::new(WindowPass { primitives, pixels_per_point, background });
        let rect = context.viewport_rect();
        let callback = viewport::window_callback(rect, self.window.clone(), pass);
        output.shapes = vec![ClippedShape::new(rect, Shape::Callback(callback))];
    }
}

fn shape(ClippedPrimitive { clip_rect, primitive }: ClippedPrimitive) -> ClippedShape {
    let shape = match primitive {
        Primitive::Mesh(mesh) => Shape::mesh(mesh),
        Primitive::Callback(callback) => Shape::Callback(callback),
    };
    ClippedShape::new(clip_rect, shape)
}

/// Returns the sampling mode of a texture; `None` if the texture repeats, which no texture of the window
/// does.
fn sampling(options: TextureOptions) -> Option<MeshSampling> {
    let is_smooth = |filter| filter == TextureFilter::Linear;
    (options.wrap_mode == TextureWrapMode::ClampToEdge).then_some(MeshSampling {
        is_magnified_smoothly: is_smooth(options.magnification),
        is_minified_smoothly: is_smooth(options.minification),
    })
}

#[derive(Debug)]
pub struct WindowPass {
    /// Meshes from back to front. They include no callbacks and use only textures that egui manages.
    primitives: Vec<ClippedPrimitive>,
    pixels_per_point: f32,
    background: Color32,
}

#[derive(Debug)]
pub struct KeptWindow {
    pub painter: MeshPainter,
    /// Egui pass that the stored image shows.
    shown: Option<Arc<WindowPass>>,
    changes: Vec<TextureChange>,
    /// Textures without transparent texels.
    opaque: HashSet<TextureId>,
}

impl KeptWindow {
    /// Returns the meshes to draw so that a window of `size` (columns, rows) shows `pass`. Only the
    /// changed regions are drawn.
    pub fn update_to_pass(&mut self, pass: &Arc<WindowPass>, size: [u32; 2]) -> MeshList {
        let before = self.shown.replace(pass.clone());
        let changes = std::mem::take(&mut self.changes);
        let comparable = before.filter(|before| {
            self.painter.size() == Some(size)
                && before.pixels_per_point == pass.pixels_per_point
                && before.background == pass.background
        });
        let places = match comparable {
            None => vec![PixelRect { min: [0; 2], max: size }],
            Some(before) => WindowDamage::between(&before.primitives, &pass.primitives, &changes)
                .0
                .into_iter()
                .map(|place| touched_pixels(place, pass.pixels_per_point, size))
                .collect(),
        };
        mesh_list(pass, size, &places, &self.opaque)
    }
}

fn touched_pixels(place: Rect, pixels_per_point: f32, size: [u32; 2]) -> PixelRect {
    // Casts saturate: positions left of the window or above it become 0.
    let (min, max) = (place.min * pixels_per_point, place.max * pixels_per_point);
    PixelRect {
        // Rounded outwards, so that partly covered pixels are drawn again.
        min: [(min.x.floor() as u32).min(size[0]), (min.y.floor() as u32).min(size[1])],
        max: [(max.x.ceil() as u32).min(size[0]), (max.y.ceil() as u32).min(size[1])],
    }
}

/// Returns the scissor rectangle for egui's clip rectangle within a region, rounded in the same way as
/// by egui's painter. `None` if it is empty.
fn scissor(clip: Rect, pixels_per_point: f32, place: PixelRect) -> Option<PixelRect> {
    let (min, max) = (clip.min * pixels_per_point, clip.max * pixels_per_point);
    let inside = PixelRect {
        min: [place.min[0].max(min.x.round() as u32), place.min[1].max(min.y.round() as u32)],
        max: [place.max[0].min(max.x.round() as u32), place.max[1].min(max.y.round() as u32)],
    };
    (inside.min[0] < inside.max[0] && inside.min[1] < inside.max[1]).then_some(inside)
}

fn mesh_list(
    pass: &WindowPass,
    size: [u32; 2],
    places: &[PixelRect],
    opaque: &HashSet<TextureId>,
) -> MeshList {
    let mut list = MeshList::default();
    for &place in places {
        let mut batches = Batches { list: &mut list, pass, size, place, open: Vec::new(), opaque };
        let points = batches.points(place);
        let covers = |primitive| covers(primitive, points, opaque);
        let cover = pass.primitives.iter().rposition(covers);
        if cover.is_none() {
            let mut background = Mesh::default();
            background.add_colored_rect(points, pass.background);
            // First, because the image still shows the last pass there.
            batches.add(&background, points);
        }
        // What lies below a picture of the scene is not drawn.
        for ClippedPrimitive { clip_rect, primitive } in &pass.primitives[cover.unwrap_or(0)..] {
            if let Primitive::Mesh(mesh) = primitive {
                batches.add(mesh, *clip_rect);
            }
        }
        batches.close();
    }
    list
}

/// True if a primitive is an upright opaque picture that hides everything below it in `place` (points).
fn covers(
    ClippedPrimitive { clip_rect, primitive }: &ClippedPrimitive,
    place: Rect,
    opaque: &HashSet<TextureId>,
) -> bool {
    let Primitive::Mesh(mesh) = primitive else { return false };
    // Two triangles whose corners are all at the corners of their bounds.
    if mesh.vertices.len() != 4 || n_triangles(mesh) != 2 || !clip_rect.contains_rect(place) {
        return false;
    }
    let bounds = mesh.calc_bounds();
    let xs = [bounds.min.x, bounds.max.x];
    let ys = [bounds.min.y, bounds.max.y];
    (0..2).all(|i| {
        let corners = triangle(mesh, i);
        self::bounds(corners) == bounds
            && corners.iter().all(|at| xs.contains(&at.pos.x) && ys.contains(&at.pos.y))
            && matches!(kind(mesh.texture_id, &corners, opaque), MeshKind::Picture(_))
    }) && triangle(mesh, 0) != triangle(mesh, 1)
        && bounds.contains_rect(place)
}

/// Number of latest batches to which a new triangle may be added.
// The search is linear in it, for every triangle.
const MAX_OPEN: usize = 8;

/// Batches of triangles in one region. A triangle is added to an earlier batch of the same kind unless it
/// overlaps a triangle of a later batch.
// Labels and buttons alternate, and every change of the pipeline is expensive.
struct Batches<'a> {
    list: &'a mut MeshList,
    pass: &'a WindowPass,
    size: [u32; 2],
    place: PixelRect,
    open: Vec<OpenBatch>,
    opaque: &'a HashSet<TextureId>,
}

struct OpenBatch {
    kind: MeshKind,
    scissor: PixelRect,
    bounds: Rect,
    indices: Vec<u32>,
}

impl Batches<'_> {
    fn add(&mut self, mesh: &Mesh, clip: Rect) {
        let scale = self.pass.pixels_per_point;
        let Some(scissor) = scissor(clip, scale, self.place) else { return };
        let inside = self.points(scissor);
        // Indices of the mesh's vertices in the list, once they are added.
        let mut places = Vec::new();
        for i in 0..n_triangles(mesh) {
            let (corners, vertices) = (corners(mesh, i), triangle(mesh, i));
            let bounds = bounds(vertices);
            if !inside.intersects(bounds) {
                continue;
            }
            // Only here, because a mesh outside the region needs no table.
            places.resize(mesh.vertices.len(), u32::MAX);
            let indices = [0, 1, 2].map(|k| {
                let place = &mut places[corners[k]];
                if *place == u32::MAX {
                    *place = self.list.vertices.len() as u32;
                    self.list.vertices.push(clip_space(vertices[k], scale, self.size));
                }
                *place
            });
            // Most triangles end inside their clip: they need no scissor and share a batch with others.
            let is_whole = inside.contains_rect(bounds);
            let scissor = if is_whole { self.place } else { scissor };
            let kind = kind(mesh.texture_id, &vertices, self.opaque);
            self.join(kind, scissor, bounds.intersect(inside), indices);
        }
    }

    fn join(&mut self, kind: MeshKind, scissor: PixelRect, bounds: Rect, indices: [u32; 3]) {
        for batch in self.open.iter_mut().rev().take(MAX_OPEN) {
            if batch.kind == kind && batch.scissor == scissor {
                batch.bounds = batch.bounds.union(bounds);
                batch.indices.extend(indices);
                return;
            }
            // An earlier batch would draw the triangle below this one.
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

fn kind(texture: TextureId, corners: &[Vertex; 3], opaque: &HashSet<TextureId>) -> MeshKind {
    match texture {
        // Shapes without a texture use a white texel.
        TextureId::Managed(0) if corners.iter().all(|corner| corner.uv == WHITE_UV) => {
            let is_opaque = corners.iter().all(|corner| corner.color.is_opaque());
            if is_opaque { MeshKind::Opaque } else { MeshKind::Blended }
        }
        TextureId::Managed(key) | TextureId::User(key) => {
            let is_white = corners.iter().all(|corner| corner.color == Color32::WHITE);
            let is_picture = is_white && opaque.contains(&texture);
            if is_picture { MeshKind::Picture(key) } else { MeshKind::Textured(key) }
        }
    }
}

fn clip_space(vertex: Vertex, pixels_per_point: f32, size: [u32; 2]) -> MeshVertex {
    let Pos2 { x, y } = vertex.pos * pixels_per_point;
    MeshVertex {
        // In clip space y points up, in the window down.
        position: [2.0 * x / size[0] as f32 - 1.0, 1.0 - 2.0 * y / size[1] as f32],
        uv: vertex.uv.into(),
        color: vertex.color.to_array(),
    }
}

/// Maximum number of separate regions. Additional regions are merged.
const MAX_PLACES: usize = 12;
/// Maximum area (points²) by which the merged rectangle of two regions may exceed the sum of their areas.
// Every region walks all meshes of the window once more.
const SLACK: f32 = 4000.0;

#[derive(Clone, Copy, Debug, PartialEq)]
struct TextureChange {
    id: TextureId,
    /// Changed area, in texture coordinates from 0 to 1.
    area: Rect,
}

/// Regions in which an egui pass differs from the previous one, points. They may overlap.
#[derive(Debug, Default)]
struct WindowDamage(Vec<Rect>);

impl WindowDamage {
    fn between(
        before: &[ClippedPrimitive],
        now: &[ClippedPrimitive],
        textures: &[TextureChange],
    ) -> Self {
        let mut damage = Self::default();
        let [gone, new] = changed([before.len(), now.len()], |i, k| is_same(&before[i], &now[k]));
        let (gone, new) = (&before[gone], &now[new]);
        if gone.len() == new.len() {
            gone.iter().zip(new).for_each(|(gone, new)| damage.add_difference(gone, new));
        } else {
            gone.iter().chain(new).for_each(|primitive| damage.add_primitive(primitive));
        }
        for primitive in now {
            textures.iter().for_each(|change| damage.add_texture(primitive, change));
        }
        damage
    }

    fn add(&mut self, place: Rect) {
        if !place.is_positive() {
            return;
        }
        let grows = |other: &Rect| other.union(place).area() - other.area() - place.area();
        let nearest =
            (0..self.0.len()).min_by(|&a, &b| grows(&self.0[a]).total_cmp(&grows(&self.0[b])));
        match nearest {
            Some(i) if self.0[i].contains_rect(place) => {}
            Some(i) if self.0.len() == MAX_PLACES || grows(&self.0[i]) <= SLACK => {
                // The merged region may reach others.
                let joined = self.0.swap_remove(i).union(place);
                self.add(joined);
            }
            _ => self.0.push(place),
        }
    }

    fn add_primitive(&mut self, primitive: &ClippedPrimitive) {
        if let Primitive::Mesh(mesh) = &primitive.primitive {
            self.add(mesh.calc_bounds().intersect(primitive.clip_rect));
        }
    }

    fn add_difference(&mut self, before: &ClippedPrimitive, now: &ClippedPrimitive) {
        let clip = now.clip_rect;
        match (&before.primitive, &now.primitive) {
            (Primitive::Mesh(a), Primitive::Mesh(b))
                if before.clip_rect == clip && a.texture_id == b.texture_id =>
            {
                let [gone, new] = changed_triangles(a, b);
                if gone.len() == new.len() {
                    // One by one: if two numbers of a panel change, the area between them is not drawn
                    // again.
                    for (gone, new) in gone.zip(new) {
                        let (gone, new) = (triangle(a, gone), triangle(b, new));
                        if gone != new {
                            self.add(bounds(gone).intersect(clip));
                            self.add(bounds(new).intersect(clip));
                        }
                    }
                } else {
                    let gone = gone.map(|i| bounds(triangle(a, i)));
                    let new = new.map(|i| bounds(triangle(b, i)));
                    self.add(gone.chain(new).fold(Rect::NOTHING, Rect::union).intersect(clip));
                }
            }
            // Another clip or texture may change every pixel of both.
            _ => [before, now].into_iter().for_each(|primitive| self.add_primitive(primitive)),
        }
    }

    fn add_texture(&mut self, primitive: &ClippedPrimitive, change: &TextureChange) {
        let Primitive::Mesh(mesh) = &primitive.primitive else { return };
        if mesh.texture_id != change.id {
            return;
        }
        for corners in (0..n_triangles(mesh)).map(|i| triangle(mesh, i)) {
            if Rect::from_points(&corners.map(|corner| corner.uv)).intersects(change.area) {
                self.add(bounds(corners).intersect(primitive.clip_rect));
            }
        }
    }
}

/// Returns the ranges in which two lists differ, between their common beginning and common end. `lengths`
/// are the lengths of the lists. `is_same` compares the elements at an index of the first list and an index
/// of the second.
fn changed(lengths: [usize; 2], is_same: impl Fn(usize, usize) -> bool) -> [Range<usize>; 2] {
    let [a, b] = lengths;
    let shorter = a.min(b);
    let head = (0..shorter).take_while(|&i| is_same(i, i)).count();
    // At most the rest of the shorter list, or an element could count for both.
    let tail = (1..=shorter - head).take_while(|i| is_same(a - i, b - i)).count();
    lengths.map(|length| head..length - tail)
}

/// Returns the ranges of triangles in which two meshes differ, between their common beginning and common
/// end.
fn changed_triangles(before: &Mesh, now: &Mesh) -> [Range<usize>; 2] {
    let (a, b) = (&before.vertices, &now.vertices);
    let [gone, new] = changed([a.len(), b.len()], |i, k| a[i] == b[k]);
    let n = [n_triangles(before), n_triangles(now)];
    changed(n, |i, k| {
        let (first, second) = (corners(before, i), corners(now, k));
        let is_head = first == second && first.iter().all(|&corner| corner < gone.start);
        // Vertices inserted in the middle shift later indices; distances from the end stay the same.
        let from_end = |mesh: &Mesh, i| corners(mesh, i).map(|corner| mesh.vertices.len() - corner);
        let is_tail = || {
            let (first, second) = (from_end(before, i), from_end(now, k));
            first == second && first.iter().all(|&corner| corner <= b.len() - new.end)
        };
        is_head || is_tail()
    })
}

fn is_same(a: &ClippedPrimitive, b: &ClippedPrimitive) -> bool {
    match (&a.primitive, &b.primitive) {
        (Primitive::Mesh(mesh), Primitive::Mesh(other)) => {
            a.clip_rect == b.clip_rect
                && mesh.texture_id == other.texture_id
                && mesh.indices == other.indices
                // As bytes, which is many times faster than comparing numbers.
                && bytemuck::cast_slice::<_, u8>(&mesh.vertices)
                    == bytemuck::cast_slice::<_, u8>(&other.vertices)
        }
        _ => false,
    }
}

fn n_triangles(mesh: &Mesh) -> usize {
    mesh.indices.len() / 3
}

fn corners(mesh: &Mesh, i: usize) -> [usize; 3] {
    [0, 1, 2].map(|k| mesh.indices[3 * i + k] as usize)
}

fn triangle(mesh: &Mesh, i: usize) -> [Vertex; 3] {
    corners(mesh, i).map(|corner| mesh.vertices[corner])
}

fn bounds(corners: [Vertex; 3]) -> Rect {
    Rect::from_points(&corners.map(|corner| corner.pos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::pos2;

    const CLIP: Rect = Rect::from_min_max(Pos2::ZERO, Pos2::new(1000.0, 1000.0));

    fn rect(x: f32, y: f32) -> Rect {
        Rect::from_min_size(pos2(x, y), Vec2::splat(10.0))
    }

    /// Creates a mesh of squares at the given positions, with the given brightness.
    fn squares(squares: &[(f32, f32, u8)]) -> ClippedPrimitive {
        let mut mesh = Mesh::default();
        for &(x, y, gray) in squares {
            mesh.add_colored_rect(rect(x, y), Color32::from_gray(gray));
        }
        ClippedPrimitive { clip_rect: CLIP, primitive: Primitive::Mesh(mesh) }
    }

    fn places(before: &[ClippedPrimitive], now: &[ClippedPrimitive]) -> Vec<Rect> {
        WindowDamage::between(before, now, &[]).0
    }

    #[test]
    fn far_changes_of_one_mesh_are_places_of_their_own_and_near_ones_are_not() {
        let before = [squares(&[(0.0, 0.0, 1), (500.0, 500.0, 2), (900.0, 900.0, 3)])];
        assert_eq!(places(&before, &before), []);
        let now = [squares(&[(0.0, 0.0, 7), (500.0, 500.0, 2), (900.0, 900.0, 8)])];
        assert_eq!(places(&before, &now), [rect(0.0, 0.0), rect(900.0, 900.0)]);
        let now = [squares(&[(0.0, 0.0, 1), (500.0, 500.0, 5), (900.0, 900.0, 3)])];
        assert_eq!(places(&before, &now), [rect(500.0, 500.0)]);
        let before = [squares(&[(0.0, 0.0, 1), (20.0, 0.0, 2)])];
        let now = [squares(&[(0.0, 0.0, 3), (20.0, 0.0, 4)])];
        assert_eq!(places(&before, &now), [rect(0.0, 0.0).union(rect(20.0, 0.0))]);
    }

    #[test]
    fn what_comes_and_goes_is_drawn_where_it_is_and_where_it_was() {
        let before = [squares(&[(0.0, 0.0, 1), (300.0, 0.0, 2)])];
        let more = [squares(&[(0.0, 0.0, 1), (600.0, 300.0, 7), (300.0, 0.0, 2)])];
        assert_eq!(places(&before, &more), [rect(600.0, 300.0)]);
        assert_eq!(places(&more, &before), [rect(600.0, 300.0)]);
        let another = [before[0].clone(), squares(&[(700.0, 700.0, 1)])];
        assert_eq!(places(&before, &another), [rect(700.0, 700.0)]);
        assert_eq!(places(&another, &before), [rect(700.0, 700.0)]);
        let moved = [squares(&[(0.0, 0.0, 1), (800.0, 0.0, 2)])];
        assert_eq!(places(&before, &moved), [rect(300.0, 0.0), rect(800.0, 0.0)]);
    }

    #[test]
    fn another_clip_or_texture_is_another_look() {
        let before = [squares(&[(0.0, 0.0, 1)])];
        let mut clipped = before.clone();
        clipped[0].clip_rect.max.y = 5.0;
        assert_eq!(places(&before, &clipped), [rect(0.0, 0.0)]);
        let other = TextureId::Managed(7);
        let mut textured = before.clone();
        let Primitive::Mesh(mesh) = &mut textured[0].primitive else { return };
        mesh.texture_id = other;
        mesh.vertices.iter_mut().for_each(|vertex| vertex.uv = pos2(0.5, 0.5));
        assert_eq!(places(&before, &textured), [rect(0.0, 0.0)]);
        let change = |id, to| TextureChange { id, area: Rect::from_min_max(Pos2::ZERO, to) };
        let places = |change| WindowDamage::between(&textured, &textured, &[change]).0;
        assert_eq!(places(change(other, pos2(1.0, 1.0))), [rect(0.0, 0.0)]);
        assert_eq!(places(change(other, pos2(0.4, 0.4))), []);
        assert_eq!(places(change(TextureId::Managed(0), pos2(1.0, 1.0))), []);
    }

    #[test]
    fn only_an_upright_opaque_picture_hides_what_is_below_it() {
        let key = TextureId::Managed(7);
        let mut mesh = Mesh::with_texture(key);
        let picture_rect = Rect::from_min_max(pos2(100.0, 100.0), pos2(300.0, 200.0));
        let uv = Rect::from_min_max(Pos2::ZERO, pos2(1.0, 1.0));
        mesh.add_rect_with_uv(picture_rect, uv, Color32::WHITE);
        let clipped = |mesh: &Mesh| ClippedPrimitive {
            clip_rect: CLIP,
            primitive: Primitive::Mesh(mesh.clone()),
        };
        let opaque = HashSet::from([key]);
        let hides = |mesh: &Mesh, place| covers(&clipped(mesh), place, &opaque);
        assert!(hides(&mesh, picture_rect));
        assert!(!hides(&mesh, picture_rect.expand(1.0)));
        assert!(!covers(&clipped(&mesh), picture_rect, &HashSet::new()), "it may be transparent");
        let mut turned = mesh.clone();
        turned.vertices[0].pos.x += 20.0;
        assert!(!hides(&turned, picture_rect));
        let mut tinted = mesh.clone();
        tinted.vertices[3].color = Color32::from_white_alpha(100);
        assert!(!hides(&tinted, picture_rect));
        let mut half = mesh.clone();
        half.indices.copy_within(0..3, 3);
        assert!(!hides(&half, picture_rect), "twice the same triangle");
        let window = [squares(&[(0.0, 0.0, 1), (150.0, 150.0, 2)]), clipped(&mesh)];
        let pass = WindowPass {
            primitives: window.to_vec(),
            pixels_per_point: 1.0,
            background: Color32::BLACK,
        };
        let drawn = |place: Rect| {
            let place = touched_pixels(place, 1.0, [1000, 1000]);
            let list = mesh_list(&pass, [1000, 1000], &[place], &opaque);
            list.batches.iter().map(|batch| batch.kind).collect::<Vec<_>>()
        };
        assert_eq!(drawn(picture_rect), [MeshKind::Picture(7)]);
        assert_eq!(drawn(picture_rect.expand(1.0)), [MeshKind::Opaque, MeshKind::Picture(7)]);
    }

    #[test]
    fn many_places_become_few_that_cover_them_all() {
        let spots: Vec<(f32, f32, u8)> =
            (0..100_u8).map(|i| (f32::from(i % 10) * 95.0, f32::from(i / 10) * 95.0, 1)).collect();
        let changed: Vec<_> = spots.iter().map(|&(x, y, gray)| (x, y, gray + 1)).collect();
        let found = places(&[squares(&spots)], &[squares(&changed)]);
        assert!((1..=MAX_PLACES).contains(&found.len()), "{found:?}");
        for (x, y, _) in spots {
            assert!(found.iter().any(|place| place.contains_rect(rect(x, y))), "{x} {y}");
        }
    }
}
