//! Projection of a depth image into another camera: squares between pixel centres, with a depth test.

use crate::math::image::Image;

/// Grid point projected into the other image.
#[derive(Clone, Copy, Debug)]
pub struct Corner {
    /// Continuous pixel coordinates.
    pub at: [f32; 2],
    /// Depth `z` in the other camera, world units, positive.
    pub z: f32,
    pub is_marked: bool,
}

/// Depth image of the other camera.
pub struct Reprojection {
    /// Depth of the nearest square; 0 if there is none.
    pub z: Image<f32>,
    /// True if all corners of that square are marked.
    pub marked: Image<bool>,
}

/// Tolerance of the triangle test, px²: adjacent triangles must not leave gaps.
const EDGE_SLACK: f32 = 1e-3;

/// Draws the squares of a grid with `width` columns that have four corners and satisfy `is_square`. Its
/// argument holds the indices of the upper left, upper right, lower left and lower right corner.
pub fn draw(
    corners: &[Option<Corner>],
    width: usize,
    is_square: impl Fn([usize; 4]) -> bool,
    [columns, rows]: [usize; 2],
) -> Reprojection {
    let mut drawn = Reprojection {
        z: Image::filled(columns, rows, 0.0),
        marked: Image::filled(columns, rows, false),
    };
    for upper_left in 0..corners.len().saturating_sub(width + 1) {
        let square = [upper_left, upper_left + 1, upper_left + width, upper_left + width + 1];
        let [Some(a), Some(b), Some(c), Some(d)] = square.map(|i| corners[i]) else { continue };
        if (upper_left + 1) % width != 0 && is_square(square) {
            let is_marked = [a, b, c, d].iter().all(|corner| corner.is_marked);
            drawn.triangle([a, b, c], is_marked);
            drawn.triangle([d, c, b], is_marked);
        }
    }
    drawn
}

impl Reprojection {
    fn triangle(&mut self, corners: [Corner; 3], is_marked: bool) {
        let [a, b, c] = corners.map(|corner| corner.at);
        let area = cross(a, b, c);
        // Triangles seen edge-on cover no pixel and have no barycentric coordinates.
        if area == 0.0 {
            return;
        }
        // The casts saturate, which clips triangles at the image border.
        let span = |axis: usize, size: usize| {
            let (lo, hi) = (a[axis].min(b[axis]).min(c[axis]), a[axis].max(b[axis]).max(c[axis]));
            // Pixel centres are at +½.
            (lo - 0.5).ceil() as usize..((hi + 0.5).floor() as usize).min(size)
        };
        // On a plane 1/z is affine in image coordinates; z is not.
        let inverse_z = corners.map(|corner| 1.0 / corner.z);
        for row in span(1, self.z.height) {
            for column in span(0, self.z.width) {
                let pixel = [column as f32 + 0.5, row as f32 + 0.5];
                let parts = [cross(b, c, pixel), cross(c, a, pixel), cross(a, b, pixel)];
                // Either winding: a square seen from behind occludes as well.
                if parts.iter().any(|part| part * area.signum() < -EDGE_SLACK) {
                    continue;
                }
                let weighted: f32 = parts.iter().zip(inverse_z).map(|(part, w)| part * w).sum();
                let z = area / weighted;
                let nearest = &mut self.z.data[row * self.z.width + column];
                if *nearest == 0.0 || z < *nearest {
                    *nearest = z;
                    self.marked.data[row * self.z.width + column] = is_marked;
                }
            }
        }
    }
}

/// Twice the signed area of a triangle.
fn cross(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}
