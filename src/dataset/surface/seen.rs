//! The depth image reprojected into a separate colour camera, for occlusion tests.

use super::planes::{NOTHING, Planes};
use crate::dataset::calibration::ColorCamera;
use crate::dataset::frame::Frame;
use crate::math::image::Image;
use crate::math::simd::{Kernel, LANES, Vector, turned};
use crate::observation::surface::Photograph;
use glam::{DQuat, DVec3};

/// Maximum side, in pixels, of the square that a depth pixel covers in the colour image. It bounds the
/// work for surfaces close to the colour camera.
const MOST_COVERED: f32 = 16.0;

/// Side of a cell in pixels of the colour image. Neighbouring depth pixels are less than a cell apart,
/// so projected surfaces have no holes.
const CELL: usize = 2;

/// Depth of the nearest surface in the colour image, for each cell of pixels and optionally for each
/// pixel.
///
/// A cell holds only depth pixels whose centres are in the cell, so occluders are not wider than
/// measured.
#[derive(Clone, Debug)]
pub(super) struct ReprojectedDepths {
    /// Depth along the colour camera's axis, world units; [`NOTHING`] where no surface was measured.
    pub nearest: Image<f32>,
    cells: Image<f32>,
}

impl Default for ReprojectedDepths {
    fn default() -> Self {
        Self { nearest: Image::filled(0, 0, NOTHING), cells: Image::filled(0, 0, NOTHING) }
    }
}

impl ReprojectedDepths {
    /// True if a point at pixel coordinates `u`, `v` and depth `depth` is more than `margin` behind
    /// another surface.
    #[inline(always)]
    pub fn occludes(&self, [u, v]: [f32; 2], depth: f32, margin: f32) -> bool {
        // Without this test, .7 % of the Kinect's points took the colour of an occluder, and their colours
        // varied 2.5 times as much as the other points' colours.
        let Image { width, height, data } = &self.cells;
        let [x, y] = [u / CELL as f32, v / CELL as f32];
        let is_inside = x >= 0.0 && y >= 0.0 && x < *width as f32 && y < *height as f32;
        is_inside && depth > data[y as usize * width + x as usize] + margin
    }
}

/// Replaces the reprojected depths by those of a frame. Each depth pixel becomes a square in the colour
/// image. Its side is `footprint` colour pixels at equal distance from both cameras. The nearest depth
/// is kept.
pub(super) struct SeeFrame<'a> {
    pub planes: &'a Planes,
    pub camera: &'a Projection,
    pub footprint: f32,
    pub size: [usize; 2],
    /// True to compute depth for every pixel in addition to cells.
    pub is_whole: bool,
    pub out: &'a mut ReprojectedDepths,
}

impl Kernel for SeeFrame<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { planes, camera, footprint, size, is_whole, out } = self;
        let [columns, rows] = size.map(|n| n.div_ceil(CELL));
        // An image of size 0 skips the per-pixel depths.
        let [width, height] = if is_whole { size } else { [0; 2] };
        begin(&mut out.nearest, [width, height]);
        begin(&mut out.cells, [columns, rows]);
        let ReprojectedDepths { nearest, cells } = out;
        let (zero, half, one) = (V::splat(0.0), V::splat(0.5), V::splat(1.0));
        let last = [V::splat(width as f32), V::splat(height as f32)];
        for (row, &y) in planes.slope_y.iter().enumerate() {
            for block in 0..planes.blocks(1) {
                let z = V::load(&planes.z[planes.at(block * LANES, row)..]);
                let usable = z.at_most(V::splat(0.5 * NOTHING));
                if usable == 0 {
                    continue;
                }
                let x = V::load(&planes.slope_x[block * LANES..]);
                let turned = camera.turned_lanes([x * z, V::splat(y) * z, z]);
                let [u, v] = camera.project_lanes(turned);
                // Squares of neighbours touch; squares smaller than a pixel fall into one pixel.
                let covered = V::splat(footprint) * z / turned[2];
                // A pixel is covered if its centre, at +½, is in the square: its first column is the ceiling
                // of `u − reach`, computed by adding one and truncating.
                let reach = half * covered.max(one).min(V::splat(MOST_COVERED)) + half;
                // Clamped to 0 first, because truncation rounds towards 0.
                let left = (u - reach + one).max(zero).truncated();
                let top = (v - reach + one).max(zero).truncated();
                let right = (u + reach).max(zero).min(last[0]).truncated();
                let bottom = (v + reach).max(zero).min(last[1]).truncated();
                let depths = turned[2].to_array();
                // Points behind the colour camera have no place in its image.
                let mut lanes = usable & V::splat(f32::MIN_POSITIVE).at_most(turned[2]);
                let [x, y] = [u / V::splat(CELL as f32), v / V::splat(CELL as f32)];
                let is_before = zero.at_most(x) & zero.at_most(y);
                let is_beyond =
                    V::splat(columns as f32).at_most(x) | V::splat(rows as f32).at_most(y);
                let inside = is_before & !is_beyond;
                let [x, y] = [x.truncated(), y.truncated()];
                while lanes != 0 {
                    let lane = lanes.trailing_zeros() as usize;
                    lanes &= lanes - 1;
                    if inside >> lane & 1 == 1 {
                        let cell = &mut cells.data[y[lane] as usize * columns + x[lane] as usize];
                        *cell = cell.min(depths[lane]);
                    }
                    for row in top[lane] as usize..bottom[lane] as usize {
                        for column in left[lane] as usize..right[lane] as usize {
                            let seen = &mut nearest.data[row * width + column];
                            *seen = seen.min(depths[lane]);
                        }
                    }
                }
            }
        }
    }
}

fn begin(image: &mut Image<f32>, [width, height]: [usize; 2]) {
    image.data.clear();
    image.data.resize(width * height, NOTHING);
    (image.width, image.height) = (width, height);
}

pub(super) struct Projection {
    /// Rotation matrix from the depth camera's axes to the colour camera's, by rows.
    turn: [[f32; 3]; 3],
    offset: [f32; 3],
    focal: [f32; 2],
    principal: [f32; 2],
}

impl Projection {
    pub fn new(camera: &ColorCamera) -> Self {
        Self {
            turn: camera.color_from_depth().transpose().to_cols_array_2d().map(single),
            offset: single(camera.offset),
            focal: single(camera.focal),
            principal: single(camera.principal),
        }
    }

    #[inline(always)]
    pub fn turned_lanes<V: Vector>(&self, [x, y, z]: [V; 3]) -> [V; 3] {
        let [right, down, ahead] = self.offset;
        turned(&self.turn, [x - V::splat(right), y - V::splat(down), z - V::splat(ahead)])
    }

    /// Projects points of the colour camera's frame to pixel coordinates. The result is undefined for
    /// points behind the camera.
    #[inline(always)]
    pub fn project_lanes<V: Vector>(&self, [x, y, z]: [V; 3]) -> [V; 2] {
        let ([fx, fy], [cx, cy]) = (self.focal, self.principal);
        [V::splat(fx) * x / z + V::splat(cx), V::splat(fy) * y / z + V::splat(cy)]
    }
}

fn single<const N: usize>(values: [f64; N]) -> [f32; N] {
    values.map(|value| value as f32)
}

/// Creates a photograph that is registered to the depth image. Reuses the memory of an earlier
/// photograph.
pub(super) fn registered(
    frame: &Frame,
    planes: &Planes,
    gain: [f64; 3],
    earlier: Option<Photograph>,
) -> Photograph {
    let Image { width, height, .. } = *frame.color;
    let rows = (0..height).map(|row| &planes.z[planes.at(0, row)..][..width]);
    Photograph {
        intrinsics: frame.camera.intrinsics,
        offset: DVec3::ZERO,
        rotation: DQuat::IDENTITY,
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, rows, earlier),
        has_coverage: true,
    }
}

/// Creates a photograph of a separate colour camera. Reuses the memory of an earlier photograph.
pub(super) fn seen_beside(
    frame: &Frame,
    seen: &ReprojectedDepths,
    camera: &ColorCamera,
    gain: [f64; 3],
    earlier: Option<Photograph>,
) -> Photograph {
    Photograph {
        intrinsics: camera.intrinsics(frame.camera.intrinsics),
        offset: DVec3::from_array(camera.offset),
        rotation: camera.rotation_quat(),
        colors: frame.color.clone(),
        gain: gain.map(|gain| gain as f32),
        depths: depths(frame, [&seen.nearest.data[..]], earlier),
        // Depth of another camera does not show what covers a pixel of this one.
        has_coverage: false,
    }
}

/// Creates the depth image of a photograph from consecutive runs of pixels. Reuses the memory of an
/// earlier photograph, because allocating a million pixels takes longer than filling them.
fn depths<'a>(
    frame: &Frame,
    runs: impl IntoIterator<Item = &'a [f32]>,
    earlier: Option<Photograph>,
) -> Image<f32> {
    let mut depths = earlier.map(|earlier| earlier.depths.data).unwrap_or_default();
    depths.clear();
    // Photographs mark unknown depth by 0.
    let known = |z: &f32| if *z < NOTHING { *z } else { 0.0 };
    runs.into_iter().for_each(|run| depths.extend(run.iter().map(known)));
    Image::from_vec(frame.color.width, frame.color.height, depths)
}
