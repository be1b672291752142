//! The crop box in the viewport: its edges, and a handle in the middle of each face.

use super::world_painter::WorldPainter;
use eframe::egui::{Color32, Pos2, Stroke, Vec2};
use glam::DVec3;

/// What a drag over the viewport does instead of turning the camera.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum EditDrag {
    /// It selects what is between its ends.
    Select,
    /// It moves a face of the crop box: twice the axis, and one more for the far face.
    Face(usize),
}

const EDGE: Color32 = Color32::from_rgb(120, 220, 255);
/// Radius of a handle and of where it can be grabbed, points.
const HANDLE: f32 = 6.0;
const GRIP: f32 = 12.0;
/// Faces of a box.
const N_FACES: usize = 6;

/// The middle of a face.
fn middle([low, high]: [DVec3; 2], face: usize) -> DVec3 {
    let (axis, mut at) = (face / 2, 0.5 * (low + high));
    at[axis] = if face.is_multiple_of(2) { low[axis] } else { high[axis] };
    at
}

/// Draws edges and handles.
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

/// The face whose handle is at a place of the window.
pub fn face_at(world: &WorldPainter, crop: [DVec3; 2], at: Pos2) -> Option<usize> {
    let distance = |face| Some((world.position(middle(crop, face))?.distance(at), face));
    let nearest = (0..N_FACES).filter_map(distance).min_by(|a, b| a.0.total_cmp(&b.0));
    nearest.filter(|(distance, _)| *distance <= GRIP).map(|(_, face)| face)
}

/// The box with a face that follows the pointer along its axis, not past the face across.
pub fn dragged(world: &WorldPainter, crop: [DVec3; 2], face: usize, by: Vec2) -> [DVec3; 2] {
    let (axis, at) = (face / 2, middle(crop, face));
    // A step that is small against the box shows which way and how fast the axis runs on screen.
    let step = 1e-3 * (crop[1] - crop[0]).max_element().max(f64::MIN_POSITIVE);
    let ends = [at, at + step * DVec3::AXES[axis]].map(|end| world.position(end));
    let [Some(from), Some(to)] = ends else { return crop };
    let along = (to - from) / step as f32;
    // Seen end-on the axis has no direction on screen.
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
