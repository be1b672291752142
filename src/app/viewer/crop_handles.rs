//! Crop box in the viewport: edges, and a handle in the middle of each face.

use super::world_painter::WorldPainter;
use eframe::egui::{Color32, Pos2, Stroke, Vec2};
use glam::DVec3;

/// Edit made by a drag in the viewport, instead of orbiting the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EditDrag {
    /// Selects the splats inside the dragged rectangle.
    Select,
    /// Moves a face of the crop box. The index is twice the axis, plus one for the far face.
    Face(usize),
}

const EDGE: Color32 = Color32::from_rgb(120, 220, 255);
/// Radius of a handle and of its grab area, points.
const HANDLE: f32 = 6.0;
const GRIP: f32 = 12.0;
const N_FACES: usize = 6;

fn middle([low, high]: [DVec3; 2], face: usize) -> DVec3 {
    let (axis, mut at) = (face / 2, 0.5 * (low + high));
    at[axis] = if face.is_multiple_of(2) { low[axis] } else { high[axis] };
    at
}

pub fn draw(world: &WorldPainter, crop: [DVec3; 2]) {
    let corner =
        |bits: usize| DVec3::from_array(std::array::from_fn(|axis| crop[bits >> axis & 1][axis]));
    for bits in 0..8 {
        for axis in (0..3).filter(|axis| bits >> axis & 1 == 0) {
            let ends = [corner(bits), corner(bits | 1 << axis)];
            world.line(ends, Stroke::new(1.5, EDGE));
        }
    }
    for at in (0..N_FACES).filter_map(|face| world.position(middle(crop, face))) {
        world.painter().circle(at, HANDLE, EDGE, Stroke::new(1.5, Color32::BLACK));
    }
}

/// Returns the face whose handle is at a window position.
pub fn face_at(world: &WorldPainter, crop: [DVec3; 2], at: Pos2) -> Option<usize> {
    let distance = |face| Some((world.position(middle(crop, face))?.distance(at), face));
    let nearest = (0..N_FACES).filter_map(distance).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.filter(|(distance, _)| *distance <= GRIP).map(|(_, face)| face)
}

/// Returns the box with one face moved along its axis by a drag of `by` points, at most to the opposite
/// face.
pub fn drag_face(world: &WorldPainter, crop: [DVec3; 2], face: usize, by: Vec2) -> [DVec3; 2] {
    let (axis, at) = (face / 2, middle(crop, face));
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
