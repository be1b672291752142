//! Regions in which a pass of the window differs from the previous one.

use eframe::egui::epaint::{ClippedPrimitive, Mesh, Primitive, Vertex};
use eframe::egui::{Rect, TextureId};
use std::ops::Range;

/// Maximum number of separate regions; further ones are merged.
const MAX_PLACES: usize = 12;
/// Two regions are merged if that adds at most this area, points².
const SLACK: f32 = 4000.0;

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TextureChange {
    pub id: TextureId,
    /// Changed area, texture coordinates.
    pub area: Rect,
}

/// Regions to draw again, points; they may overlap.
#[derive(Debug, Default)]
pub struct WindowDamage(Vec<Rect>);

impl WindowDamage {
    /// Regions that differ between two passes, given the textures that changed meanwhile.
    pub fn between(
        before: &[ClippedPrimitive],
        now: &[ClippedPrimitive],
        textures: &[TextureChange],
    ) -> Self {
        let mut damage = Self::default();
        let shorter = before.len().min(now.len());
        let head = (0..shorter).take_while(|&i| is_same(&before[i], &now[i])).count();
        let tail = (1..=shorter - head)
            .take_while(|i| is_same(&before[before.len() - i], &now[now.len() - i]))
            .count();
        let (gone, new) = (&before[head..before.len() - tail], &now[head..now.len() - tail]);
        if gone.len() == new.len() {
            gone.iter().zip(new).for_each(|(gone, new)| damage.add_difference(gone, new));
        } else {
            gone.iter().chain(new).for_each(|primitive| damage.add_primitive(primitive));
        }
        for primitive in now {
            for change in textures {
                damage.add_texture(primitive, change);
            }
        }
        damage
    }

    pub fn regions(&self) -> &[Rect] {
        &self.0
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
                let [gone, new] = differing(a, b);
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
            _ => [before, now].into_iter().for_each(|primitive| self.add_primitive(primitive)),
        }
    }

    fn add_texture(&mut self, primitive: &ClippedPrimitive, change: &TextureChange) {
        let Primitive::Mesh(mesh) = &primitive.primitive else { return };
        if mesh.texture_id != change.id {
            return;
        }
        for i in 0..mesh.indices.len() / 3 {
            let corners = triangle(mesh, i);
            if Rect::from_points(&corners.map(|corner| corner.uv)).intersects(change.area) {
                self.add(bounds(corners).intersect(primitive.clip_rect));
            }
        }
    }
}

fn is_same(a: &ClippedPrimitive, b: &ClippedPrimitive) -> bool {
    match (&a.primitive, &b.primitive) {
        (Primitive::Mesh(mesh), Primitive::Mesh(other)) => {
            a.clip_rect == b.clip_rect
                && mesh.texture_id == other.texture_id
                && mesh.indices == other.indices
                // As bytes, which is many times faster than comparing numbers.
                && bytes(&mesh.vertices) == bytes(&other.vertices)
        }
        _ => false,
    }
}

fn bytes(vertices: &[Vertex]) -> &[u8] {
    bytemuck::cast_slice(vertices)
}

/// Triangles of two meshes without those that are the same at the beginning and at the end of both.
fn differing(before: &Mesh, now: &Mesh) -> [Range<usize>; 2] {
    let (a, b) = (&before.vertices, &now.vertices);
    let shorter = a.len().min(b.len());
    let head = (0..shorter).take_while(|&i| a[i] == b[i]).count();
    let tail = (1..=shorter - head).take_while(|i| a[a.len() - i] == b[b.len() - i]).count();
    let n_triangles = [before, now].map(|mesh| mesh.indices.len() / 3);
    let shorter = n_triangles[0].min(n_triangles[1]);
    let corners = |mesh: &Mesh, i: usize| [0, 1, 2].map(|k| mesh.indices[3 * i + k] as usize);
    let first = (0..shorter)
        .take_while(|&i| {
            let (a, b) = (corners(before, i), corners(now, i));
            a == b && a.iter().all(|&corner| corner < head)
        })
        .count();
    let last = (1..=shorter - first)
        .take_while(|i| {
            let from_end = |mesh: &Mesh, n: usize| {
                corners(mesh, n - i).map(|corner| mesh.vertices.len() - corner)
            };
            let (a, b) = (from_end(before, n_triangles[0]), from_end(now, n_triangles[1]));
            a == b && a.iter().all(|&corner| corner <= tail)
        })
        .count();
    n_triangles.map(|n| first..n - last)
}

fn triangle(mesh: &Mesh, i: usize) -> [Vertex; 3] {
    [0, 1, 2].map(|k| mesh.vertices[mesh.indices[3 * i + k] as usize])
}

fn bounds(corners: [Vertex; 3]) -> Rect {
    Rect::from_points(&corners.map(|corner| corner.pos))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eframe::egui::{Color32, Pos2, Vec2, pos2};

    const CLIP: Rect = Rect::from_min_max(Pos2::ZERO, Pos2::new(1000.0, 1000.0));

    fn rect(x: f32, y: f32) -> Rect {
        Rect::from_min_size(pos2(x, y), Vec2::splat(10.0))
    }

    /// Creates a mesh of squares with these positions and brightnesses.
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
    fn what_stays_is_not_drawn_again() {
        let there = [squares(&[(0.0, 0.0, 1), (500.0, 500.0, 2)]), squares(&[(900.0, 0.0, 3)])];
        assert_eq!(places(&there, &there), []);
        let other = [squares(&[(0.0, 0.0, 1), (500.0, 500.0, 9)]), squares(&[(900.0, 0.0, 3)])];
        assert_eq!(places(&there, &other), [rect(500.0, 500.0)]);
    }

    #[test]
    fn far_changes_of_one_mesh_are_places_of_their_own_and_near_ones_are_not() {
        let before = [squares(&[(0.0, 0.0, 1), (500.0, 500.0, 2), (900.0, 900.0, 3)])];
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
