//! Ray casting of one view.
//!
//! One ray passes through each pixel centre, without supersampling: colour and depth of a pixel belong to
//! the same surface point, so a loader can be tested on every pixel. Textures are prefiltered over the
//! footprint of a pixel instead. Pixels are cast in tiles; each tile tests only solids whose projected
//! bounding boxes overlap it, nearest first.

use super::params::{ParamsError, SyntheticCamera, SyntheticParams};
use super::plan::{PlannedSplit, ViewPlan};
use super::room;
use super::room::{FurnishedRoom, Solid};
use super::scene::LightMaps;
use super::solid::{Hit, Ray};
use super::texture::SurfaceSample;
use crate::dataset::entry::{DatasetSplit, FrameEntry, FrameSource};
use crate::dataset::formats::Layout;
use crate::dataset::opened::Dataset;
use crate::dataset::options::LoadOptions;
use crate::dataset::range::PositionRange;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use glam::{DVec2, DVec3, Vec3};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Colour and exact depth of one view.
#[derive(Clone, Debug)]
pub struct SyntheticView {
    /// Colour, sRGB-encoded and opaque.
    pub color: Image<[u8; 4]>,
    /// Depth along the optical axis, metres. It is positive in every pixel, because the room is closed.
    pub depth_z: Image<f64>,
}

/// Side, in pixels, of the tiles that share a list of candidate solids.
const TILE: usize = 16;

/// Number of pixels below which an image is rendered on one thread. Demo frames are already decoded in
/// parallel.
const MIN_PARALLEL: usize = 1 << 18;

pub(super) fn render(room: &FurnishedRoom, light: &LightMaps, camera: &Camera) -> SyntheticView {
    let tone = ToneCurve::new();
    // Rays of a camera outside the room may miss: black, and a depth hole.
    let view = cast_rays(room, camera, ([0, 0, 0, 255], 0.0), |ray, solid, hit| {
        let light = shade(room, light, ray, solid, hit, &camera.intrinsics);
        (tone.pixel(light), hit.t) // the ray direction has z = 1 in the camera frame
    });
    SyntheticView { color: view.map(|(color, _)| *color), depth_z: view.map(|(_, z)| *z) }
}

pub(super) fn radiance(room: &FurnishedRoom, light: &LightMaps, camera: &Camera) -> Image<Vec3> {
    cast_rays(room, camera, Vec3::ZERO, |ray, solid, hit| {
        shade(room, light, ray, solid, hit, &camera.intrinsics)
    })
}

/// Casts a ray through each pixel centre. `seen` maps the ray, the index of the first solid and the hit
/// to the pixel's value. Rays without a hit yield `miss`.
pub(super) fn cast_rays<T: Copy + Send + Sync>(
    room: &FurnishedRoom,
    camera: &Camera,
    miss: T,
    seen: impl Fn(&Ray, usize, Hit) -> T + Sync,
) -> Image<T> {
    let k = camera.intrinsics;
    let (width, height) = (k.width as usize, k.height as usize);
    let mut reaches: Vec<_> = room
        .solids
        .iter()
        .enumerate()
        .map(|(i, solid)| ScreenBounds::new(i, solid, camera))
        .collect();
    // Front to back, so that the search for the first hit can stop early.
    reaches.sort_by(|a, b| a.nearest_z.total_cmp(&b.nearest_z));
    let (rotation, origin) = (camera.pose.rotation(), camera.pose.centre());
    let cast_band = |(band, pixels): (usize, &mut [T])| {
        let top = band * TILE;
        let mut in_reach = Vec::new();
        for left in (0..width).step_by(TILE) {
            let tile = [left..(left + TILE).min(width), top..(top + TILE).min(height)];
            in_reach.clear();
            in_reach.extend(reaches.iter().filter(|reach| reach.overlaps(&tile)));
            let [columns, rows] = tile;
            for row in rows {
                for column in columns.clone() {
                    let ray = Ray::new(origin, rotation * k.ray(column, row));
                    if let Some((solid, hit)) = first_hit(room, &in_reach, &ray) {
                        pixels[(row - top) * width + column] = seen(&ray, solid, hit);
                    }
                }
            }
        }
    };
    let mut image = Image::filled(width, height, miss);
    if width * height < MIN_PARALLEL {
        image.data.chunks_mut(TILE * width).enumerate().for_each(cast_band);
    } else {
        image.data.par_chunks_mut(TILE * width).enumerate().for_each(cast_band);
    }
    image
}

#[inline]
fn first_hit(room: &FurnishedRoom, in_reach: &[&ScreenBounds], ray: &Ray) -> Option<(usize, Hit)> {
    let mut best: Option<(usize, Hit)> = None;
    for reach in in_reach {
        let limit = best.map_or(f64::INFINITY, |(_, hit)| hit.t);
        // Sorted by nearest depth: the remaining solids lie behind the hit.
        if reach.nearest_z > limit {
            break;
        }
        if let Some(hit) = room.solids[reach.solid].shape.intersect(ray)
            && hit.t < limit
        {
            best = Some((reach.solid, hit));
        }
    }
    best
}

fn shade(
    room: &FurnishedRoom,
    light: &LightMaps,
    ray: &Ray,
    index: usize,
    hit: Hit,
    k: &Intrinsics,
) -> Vec3 {
    let Solid { shape, texture } = &room.solids[index];
    let world = ray.at(hit.t);
    let uv = shape.chart(world, hit.face);
    let size = shape.face_size(hit.face);
    // Footprint of a pixel at this depth, metres.
    let blur = (hit.t / k.fx) as f32;
    let place =
        SurfaceSample { world, uv, size, face: hit.face, pixel_footprint: blur, seed: room.seed };
    let albedo = texture.albedo(&place);
    match texture.is_emissive() {
        true => albedo,
        false => albedo * light.at(index, hit.face, uv),
    }
}

/// Image region that a solid may cover, from the projection of its bounding box.
struct ScreenBounds {
    solid: usize,
    columns: Range<usize>,
    rows: Range<usize>,
    /// Lower bound on the depth of those points of the solid that are in front of the camera, metres.
    nearest_z: f64,
}

impl ScreenBounds {
    fn new(index: usize, solid: &Solid, camera: &Camera) -> Self {
        // Nearer corners would project to huge coordinates.
        const NEAR: f64 = 1e-3;
        let (lo, hi) = solid.shape.bounds();
        let k = &camera.intrinsics;
        let (width, height) = (k.width as usize, k.height as usize);
        let (mut low, mut high) = (DVec2::INFINITY, DVec2::NEG_INFINITY);
        let (mut nearest_z, mut farthest_z) = (f64::INFINITY, f64::NEG_INFINITY);
        for corner in 0..8 {
            let pick = |axis: usize| if corner >> axis & 1 == 0 { lo[axis] } else { hi[axis] };
            let (pixel, z) = camera.project(DVec3::new(pick(0), pick(1), pick(2)));
            (low, high) = (low.min(pixel), high.max(pixel));
            (nearest_z, farthest_z) = (nearest_z.min(z), farthest_z.max(z));
        }
        if farthest_z <= 0.0 {
            return Self { solid: index, columns: 0..0, rows: 0..0, nearest_z: f64::INFINITY };
        }
        if nearest_z < NEAR {
            // The box extends behind the camera, where its projection is undefined.
            return Self { solid: index, columns: 0..width, rows: 0..height, nearest_z: 0.0 };
        }
        // Float casts saturate: a box to the left of the image gets 0..0.
        // One extra pixel per side covers the rounding of the projection.
        let range = |low: f64, high: f64, n: usize| {
            (low - 1.0).max(0.0) as usize..((high + 1.0).max(0.0) as usize).min(n)
        };
        let columns = range(low.x, high.x, width);
        Self { solid: index, columns, rows: range(low.y, high.y, height), nearest_z }
    }

    fn overlaps(&self, [columns, rows]: &[Range<usize>; 2]) -> bool {
        let meet = |a: &Range<usize>, b: &Range<usize>| a.start < b.end && b.start < a.end;
        meet(&self.columns, columns) && meet(&self.rows, rows)
    }
}

/// Tone curve from linear radiance to display bytes: an exponential shoulder, followed by the sRGB
/// curve. It is tabulated over the square root of radiance, for finer steps in the shadows.
pub(super) struct ToneCurve {
    table: Vec<u8>,
}

impl ToneCurve {
    const STEPS: usize = 4096;
    const WHITE: f32 = 6.0;
    const EXPOSURE: f32 = 1.15;

    pub fn new() -> Self {
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
    pub fn pixel(&self, light: Vec3) -> [u8; 4] {
        let [r, g, b] = light.to_array().map(|channel| self.byte(channel));
        [r, g, b, 255]
    }

    #[inline]
    fn byte(&self, light: f32) -> u8 {
        let root = (light.max(0.0) * (1.0 / Self::WHITE)).sqrt();
        // Brighter radiance is white as well.
        self.table[((root * Self::STEPS as f32) as usize).min(Self::STEPS)]
    }
}

/// Returns the demo as a dataset, with the parameters [`SyntheticParams::demo`].
pub fn demo() -> Result<Dataset, ParamsError> {
    dataset(&SyntheticParams::demo())
}

/// Returns a dataset whose frames are rendered when loaded.
///
/// # Errors
/// Fails for parameters outside their range, or for the phone camera, whose recordings need files.
pub fn dataset(params: &SyntheticParams) -> Result<Dataset, ParamsError> {
    if params.camera != SyntheticCamera::Room {
        let found = "the phone, whose recordings must be written to files".to_owned();
        return Err(ParamsError { setting: "camera", expected: "the room's camera", found });
    }
    let ViewPlan { scene, splits, .. } = ViewPlan::new(params)?;
    let intrinsics = scene.intrinsics();
    let split = |planned: PlannedSplit| {
        let entry = |(i, pose): (usize, Pose)| FrameEntry {
            name: format!("{}/{i:04}", planned.name),
            camera: Camera { intrinsics, pose },
            color_camera: None,
            time: None,
            source: FrameSource::Synthetic {
                scene: Arc::clone(&scene),
                noise_stream: planned.noise_stream(i),
            },
        };
        let frames = planned.poses.iter().copied().enumerate().map(entry).collect();
        DatasetSplit { name: planned.name.to_owned(), frames, has_depth: true }
    };
    Ok(Dataset {
        name: "synthetic room".to_owned(),
        path: None,
        is_folder: false,
        unpacked: None,
        layout: Layout::Synthetic,
        recognised_by: "generated, no files".to_owned(),
        splits: splits.into_iter().map(split).collect(),
        warnings: Vec::new(),
        notes: Vec::new(),
        unused: Vec::new(),
        known_range: position_range(),
        options: LoadOptions::default(),
    })
}

/// Returns the bounds of the room, which contain every point of the scene.
pub fn position_range() -> Option<PositionRange> {
    PositionRange::new(room::LO, room::HI, "the bounds of the synthetic room")
}
