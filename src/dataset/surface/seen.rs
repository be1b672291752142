//! The depth image as a colour camera that stands beside the depth camera sees it.

use super::planes::{NOTHING, Planes};
use super::projection::Projection;
use crate::math::image::Image;
use crate::math::simd::{Kernel, LANES, Vector};

/// Pixels that a pixel of the depth image covers at most, however much finer photographs are and however
/// much nearer their camera stands.
const MOST_COVERED: f32 = 16.0;

/// Pixels of the colour image on a side of a cell. Depth pixels then lie less than a cell apart, so
/// that surfaces have no holes.
const CELL: usize = 2;

/// Depth of the nearest surface in every pixel of a colour image, if it is wanted, and in cells of it by the
/// centres of the depth image's pixels: calibration needs what hides a point to be no wider than was measured.
#[derive(Clone, Debug)]
pub(super) struct SeenDepths {
    /// Along the colour camera's axis, world units; [`NOTHING`] where no surface was measured.
    pub nearest: Image<f32>,
    cells: Image<f32>,
}

impl Default for SeenDepths {
    fn default() -> Self {
        Self { nearest: Image::filled(0, 0, NOTHING), cells: Image::filled(0, 0, NOTHING) }
    }
}

impl SeenDepths {
    /// Whether a point at a depth lies more than `margin` behind another surface at its pixel coordinates.
    #[inline(always)]
    pub fn hide(&self, [u, v]: [f32; 2], depth: f32, margin: f32) -> bool {
        // Without this .7 % of the Kinect's points took the colour of what stands before them; it
        // varied 2.5 times as much as that of the rest.
        let Image { width, height, data } = &self.cells;
        let [x, y] = [u / CELL as f32, v / CELL as f32];
        let is_inside = x >= 0.0 && y >= 0.0 && x < *width as f32 && y < *height as f32;
        is_inside && depth > data[y as usize * width + x as usize] + margin
    }
}

/// Replaces what is seen by a frame: what a pixel of the depth image covers in the colour image, `footprint`
/// pixels of that at equal distance, becomes a square; the nearest wins.
pub(super) struct SeeFrame<'a> {
    pub planes: &'a Planes,
    pub camera: &'a Projection,
    pub footprint: f32,
    /// Columns and rows of the colour image.
    pub size: [usize; 2],
    /// Whether every pixel is told, and not cells alone.
    pub is_whole: bool,
    pub out: &'a mut SeenDepths,
}

impl Kernel for SeeFrame<'_> {
    type Output = ();

    #[inline(always)]
    fn run<V: Vector>(self) {
        let Self { planes, camera, footprint, size, is_whole, out } = self;
        let [columns, rows] = size.map(|n| n.div_ceil(CELL));
        // Without pixels no square has any.
        let [width, height] = if is_whole { size } else { [0; 2] };
        begin(&mut out.nearest, [width, height]);
        begin(&mut out.cells, [columns, rows]);
        let SeenDepths { nearest, cells } = out;
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
                // Squares of neighbours meet; smaller ones than a pixel fall into one.
                let covered = V::splat(footprint) * z / turned[2];
                let reach = half * covered.max(one).min(V::splat(MOST_COVERED)) + half;
                // Truncated towards 0: below that nothing may be.
                let left = (u - reach + one).max(zero).truncated();
                let top = (v - reach + one).max(zero).truncated();
                let right = (u + reach).max(zero).min(last[0]).truncated();
                let bottom = (v + reach).max(zero).min(last[1]).truncated();
                let depths = turned[2].to_array();
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

/// Nothing is seen in any pixel of an image of so many columns and rows.
fn begin(image: &mut Image<f32>, [width, height]: [usize; 2]) {
    image.data.clear();
    image.data.resize(width * height, NOTHING);
    (image.width, image.height) = (width, height);
}
