//! Ray casting of one view.

use super::light::LightMaps;
use super::room::{Room, Solid};
use super::solid::{Hit, Ray};
use super::texture::Place;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use glam::{DVec3, Vec3};
use std::ops::Range;

/// Colour and exact depth of one view.
#[derive(Clone, Debug)]
pub struct View {
    /// sRGB-encoded, opaque.
    pub color: Image<[u8; 4]>,
    /// Depth along the optical axis, metres; positive everywhere, the room is closed.
    pub depth_z: Image<f64>,
}

/// Pixels on a side of the tiles that share a list of solids in reach.
const TILE: usize = 16;

/// Casts one ray through each pixel's centre.
pub(super) fn render(room: &Room, light: &LightMaps, camera: &Camera) -> View {
    let k = camera.intrinsics;
    let (width, height) = (k.width as usize, k.height as usize);
    let windows: Vec<_> = room.solids.iter().map(|solid| window(solid, camera)).collect();
    let tone = ToneCurve::new();
    let mut color = Image::filled(width, height, [0, 0, 0, 255]);
    let mut depth_z = Image::filled(width, height, 0.0);
    let mut in_reach = Vec::new();
    let (rotation, origin) = (camera.pose.rotation(), camera.pose.centre());
    for top in (0..height).step_by(TILE) {
        for left in (0..width).step_by(TILE) {
            let tile = [left..(left + TILE).min(width), top..(top + TILE).min(height)];
            in_reach.clear();
            in_reach.extend((0..windows.len()).filter(|i| overlap(&windows[*i], &tile)));
            let [columns, rows] = tile;
            for row in rows {
                for column in columns.clone() {
                    let ray = Ray::new(origin, rotation * k.ray(column, row));
                    // A camera outside the room may see nothing: black, and a hole.
                    let Some((solid, hit)) = nearest(room, &in_reach, &ray) else { continue };
                    let [r, g, b] = shade(room, light, &ray, solid, hit, &k).to_array();
                    let i = row * width + column;
                    color.data[i] = [tone.byte(r), tone.byte(g), tone.byte(b), 255];
                    depth_z.data[i] = hit.t; // the ray's direction has z = 1 in the camera
                }
            }
        }
    }
    View { color, depth_z }
}

fn overlap(a: &[Range<usize>; 2], b: &[Range<usize>; 2]) -> bool {
    (0..2).all(|axis| a[axis].start < b[axis].end && b[axis].start < a[axis].end)
}

#[inline]
fn nearest(room: &Room, in_reach: &[usize], ray: &Ray) -> Option<(usize, Hit)> {
    let mut best: Option<(usize, Hit)> = None;
    for solid in in_reach {
        if let Some(hit) = room.solids[*solid].shape.intersect(ray)
            && best.is_none_or(|(_, b)| hit.t < b.t)
        {
            best = Some((*solid, hit));
        }
    }
    best
}

fn shade(
    room: &Room,
    light: &LightMaps,
    ray: &Ray,
    index: usize,
    hit: Hit,
    k: &Intrinsics,
) -> Vec3 {
    let Solid { shape, material } = &room.solids[index];
    let world = ray.at(hit.t);
    let uv = shape.chart(world, hit.face);
    let size = shape.face_size(hit.face);
    let blur = (hit.t / k.fx) as f32;
    let place = Place { world, uv, size, face: hit.face, blur, seed: room.seed };
    let albedo = material.albedo(&place);
    match material.is_emissive() {
        true => albedo,
        false => albedo * light.at(index, hit.face, uv),
    }
}

/// Columns and rows of the image that a solid can reach: the projection of its bounding box, or
/// everything if the box reaches behind the camera.
fn window(solid: &Solid, camera: &Camera) -> [Range<usize>; 2] {
    const NEAR: f64 = 1e-3;
    let (lo, hi) = solid.shape.bounds();
    let k = &camera.intrinsics;
    let (width, height) = (k.width as usize, k.height as usize);
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    for corner in 0..8 {
        let pick = |axis: usize| if corner >> axis & 1 == 0 { lo[axis] } else { hi[axis] };
        let (pixel, z) = camera.project(DVec3::new(pick(0), pick(1), pick(2)));
        if z < NEAR {
            return [0..width, 0..height];
        }
        for axis in 0..2 {
            low[axis] = low[axis].min(pixel[axis]);
            high[axis] = high[axis].max(pixel[axis]);
        }
    }
    // Casts saturate: a window left of the image is 0..0.
    let range = |axis: usize, n: usize| {
        (low[axis] - 1.0).max(0.0) as usize..((high[axis] + 1.0).max(0.0) as usize).min(n)
    };
    [range(0, width), range(1, height)]
}

/// Linear light to display bytes: an exponential shoulder, then the sRGB curve, tabulated over the
/// square root of the light because shadows need the finer steps.
struct ToneCurve {
    table: Vec<u8>,
}

impl ToneCurve {
    const STEPS: usize = 4096;
    const WHITE: f32 = 6.0;
    const EXPOSURE: f32 = 1.0;

    fn new() -> Self {
        let entry = |i: usize| {
            let root = i as f32 / Self::STEPS as f32;
            let linear = 1.0 - (-Self::EXPOSURE * root * root * Self::WHITE).exp();
            let encoded = match linear <= 0.003_130_8 {
                true => 12.92 * linear,
                false => 1.055 * linear.powf(1.0 / 2.4) - 0.055,
            };
            crate::math::image::unit_to_byte(encoded)
        };
        Self { table: (0..=Self::STEPS).map(entry).collect() }
    }

    #[inline]
    fn byte(&self, light: f32) -> u8 {
        let root = (light.max(0.0) * (1.0 / Self::WHITE)).sqrt();
        self.table[((root * Self::STEPS as f32) as usize).min(Self::STEPS)]
    }
}
