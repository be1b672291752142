//! Surfaces measured by a view's depth: depth per pixel, interior pixels, and projection into another
//! camera.
//!
//! Depth cameras err at edges and have holes, so interior pixels are away from both by a margin. The image
//! border is not an edge, since surfaces continue beyond it. Surfaces are projected into another camera as
//! squares between pixel centres, because points would leave gaps that read as holes.

use crate::dataset::frame::{DepthKind, Frame};
use crate::dataset::surface::Sensor;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use rayon::prelude::*;

/// Number of pixels on each side of an edge, along rows and columns, that are not interior
/// (`evaluation.md`, Cracks).
const EDGE_MARGIN: usize = 5;

/// Surfaces visible in one camera's image.
#[derive(Clone, Debug)]
pub struct Surfaces {
    pub camera: Camera,
    /// Depth along the optical axis per pixel, world units; 0 if unknown.
    pub z: Image<f32>,
    /// True for pixels away from depth jumps and holes. The image border is not an edge.
    pub interior: Image<bool>,
    jump: [f32; 2],
}

impl Surfaces {
    /// Returns the surfaces measured by the frame's depth camera; `None` if the frame has no depth.
    /// Only depth in the trusted interval and at opaque pixels is used. Neighbouring depths within the
    /// sensor's margin ([`DepthTolerance::margin`](crate::observation::surface::DepthTolerance)) belong
    /// to one surface.
    pub fn of(frame: &Frame, sensor: Sensor) -> Option<Self> {
        let depth = frame.depth.as_ref()?;
        let mut z = depth.trusted_z(&frame.camera.intrinsics).map(|&z| z as f32);
        // Translucent pixels show a background of unknown depth.
        let translucent = z.data.iter_mut().enumerate().filter(|(i, _)| !frame.is_opaque(*i));
        translucent.for_each(|(_, z)| *z = 0.0);
        let profile = sensor.profile(depth, &frame.camera.intrinsics);
        Some(Self::new(frame.camera, z, profile.tolerance.margin))
    }

    /// Creates surfaces from depth z (0 if unknown). Neighbouring pixels whose depths differ by more than
    /// `jump[0] + jump[1]·z` (world units) belong to different surfaces.
    pub fn new(camera: Camera, z: Image<f32>, jump: [f32; 2]) -> Self {
        Self { camera, interior: interior(&z, jump), z, jump }
    }

    /// Projects the surfaces into another camera. Squares between the centres of four neighbouring
    /// pixels without a jump are drawn with a depth test. Points whose depth is at most `near` (world
    /// units) are dropped. Interior pixels of the result are interior in both images.
    pub fn project_into(&self, camera: &Camera, near: f32) -> Self {
        let corners = self.corners(camera, near);
        let width = self.z.width;
        let are_one = |a: usize, b: usize| !is_jump(self.z.data[a], self.z.data[b], self.jump);
        let is_square = |[a, b, c, d]: [usize; 4]| {
            are_one(a, b) && are_one(c, d) && are_one(a, c) && are_one(b, d)
        };
        let Intrinsics { width: columns, height: rows, .. } = camera.intrinsics;
        let drawn = draw(&corners, width, is_square, [columns as usize, rows as usize]);
        let mut interior = interior(&drawn.z, self.jump);
        for (inside, &was_inside) in interior.data.iter_mut().zip(&drawn.marked.data) {
            *inside &= was_inside;
        }
        Self { camera: *camera, z: drawn.z, interior, jump: self.jump }
    }

    fn corners(&self, camera: &Camera, near: f32) -> Vec<Option<Corner>> {
        let (rotation, translation) = camera.pose.inverse();
        let there_from_here = rotation * self.camera.pose.rotation();
        let shift = rotation * self.camera.pose.centre() + translation;
        let (here, there) = (&self.camera.intrinsics, &camera.intrinsics);
        let width = self.z.width;
        let corner = |(i, &z): (usize, &f32)| {
            let p = there_from_here * (here.ray(i % width, i / width) * f64::from(z)) + shift;
            // f64 up to here: far from the world origin, f32 would displace the pixel.
            (z > 0.0 && p.z as f32 > near).then(|| Corner {
                at: [there.fx * p.x / p.z + there.cx, there.fy * p.y / p.z + there.cy]
                    .map(|x| x as f32),
                z: p.z as f32,
                is_marked: self.interior.data[i],
            })
        };
        self.z.data.par_iter().enumerate().map(corner).collect()
    }

    /// Returns depth in a renderer's convention; 0 if unknown.
    pub fn depth_of_kind(&self, kind: DepthKind) -> Image<f32> {
        let mut depth = self.z.clone();
        if kind == DepthKind::RayDistance {
            for (i, value) in depth.data.iter_mut().enumerate() {
                let ray = self.camera.intrinsics.ray(i % depth.width, i / depth.width);
                *value *= ray.length() as f32;
            }
        }
        depth
    }

    /// Returns the median depth z of the interior pixels in world units; `None` if there are no
    /// interior pixels.
    pub fn median_interior_z(&self) -> Option<f32> {
        let pixels = self.z.data.iter().zip(&self.interior.data);
        let mut inside: Vec<f32> = pixels.filter(|(_, inside)| **inside).map(|(z, _)| *z).collect();
        let middle = inside.len() / 2;
        (!inside.is_empty()).then(|| *inside.select_nth_unstable_by(middle, f32::total_cmp).1)
    }
}

/// True if two neighbouring pixels do not show one surface: one is a hole, or their depths differ too
/// much.
fn is_jump(a: f32, b: f32, jump: [f32; 2]) -> bool {
    let nearer = a.min(b);
    nearer <= 0.0 || (a - b).abs() > jump[0] + jump[1] * nearer
}

fn interior(z: &Image<f32>, jump: [f32; 2]) -> Image<bool> {
    dilate(&edges(z, jump)).map(|&is_near_edge| !is_near_edge)
}

/// Marks holes and the pixels on both sides of a jump.
fn edges(z: &Image<f32>, jump: [f32; 2]) -> Image<bool> {
    let (width, height) = (z.width, z.height);
    let mut edges = z.map(|&z| z <= 0.0);
    let mut mark = |a: usize, b: usize| {
        if is_jump(z.data[a], z.data[b], jump) {
            // Both sides: depth alone does not show which of the two surfaces ends here.
            edges.data[a] = true;
            edges.data[b] = true;
        }
    };
    for row in 0..height {
        for i in row * width..(row + 1) * width {
            if i + 1 < (row + 1) * width {
                mark(i, i + 1);
            }
            if row + 1 < height {
                mark(i, i + width);
            }
        }
    }
    edges
}

/// Dilates the marks by [`EDGE_MARGIN`] pixels: along rows, then along columns.
fn dilate(marks: &Image<bool>) -> Image<bool> {
    let (width, height) = (marks.width, marks.height);
    let mut along = Image::filled(width, height, false);
    let mut square = along.clone();
    // Chunks of length 0 would panic.
    if width == 0 || height == 0 {
        return square;
    }
    along.data.par_chunks_mut(width).zip(marks.data.par_chunks(width)).for_each(|(out, row)| {
        for (i, out) in out.iter_mut().enumerate() {
            *out =
                row[i.saturating_sub(EDGE_MARGIN)..width.min(i + EDGE_MARGIN + 1)].contains(&true);
        }
    });
    square.data.par_chunks_mut(width).enumerate().for_each(|(row, out)| {
        let rows = row.saturating_sub(EDGE_MARGIN)..height.min(row + EDGE_MARGIN + 1);
        for above in along.data[rows.start * width..rows.end * width].chunks(width) {
            out.iter_mut().zip(above).for_each(|(out, mark)| *out |= mark);
        }
    });
    square
}

/// Corner of a square, projected into the other camera's image; `at` is in continuous pixel coordinates.
#[derive(Clone, Copy, Debug)]
struct Corner {
    at: [f32; 2],
    z: f32,
    is_marked: bool,
}

/// Images of the other camera: depth of the nearest square, and whether all corners of that square are
/// marked.
struct Reprojection {
    z: Image<f32>,
    marked: Image<bool>,
}

/// Tolerance of the triangle test in square pixels, so that adjacent triangles leave no gaps.
const EDGE_SLACK: f32 = 1e-3;

/// Draws the squares of a grid with `width` columns that have four corners and satisfy `is_square`. Its
/// argument holds the indices of the upper left, upper right, lower left and lower right corner.
fn draw(
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

/// Returns twice the signed area of a triangle.
fn cross(a: [f32; 2], b: [f32; 2], c: [f32; 2]) -> f32 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::dataset::frame::{Depth, DepthCodes};
    use crate::math::pose::Pose;
    use glam::{DQuat, DVec3};
    use std::sync::Arc;

    pub fn camera(width: u32, height: u32) -> Camera {
        let intrinsics = Intrinsics::from_horizontal_fov(width, height, 0.9);
        Camera { intrinsics, pose: Pose::IDENTITY }
    }

    /// Returns a black frame with depth codes `edit(column, row)` in millimetres.
    pub fn wall(camera: Camera, edit: impl Fn(usize, usize) -> u16) -> Frame {
        let (width, height) = (camera.intrinsics.width as usize, camera.intrinsics.height as usize);
        let codes = (0..width * height).map(|i| edit(i % width, i / width)).collect();
        let codes = Image::from_vec(width, height, codes);
        let codes = DepthCodes::Linear16 { codes, unit: 1e-3 };
        let trusted = [0.1, 4.0];
        Frame {
            name: "wall".to_owned(),
            camera,
            color: Image::filled(width, height, [0, 0, 0, 255]).into(),
            color_camera: None,
            depth: Some(Depth { codes, kind: DepthKind::Z, trusted, units_per_metre: 1.0 }),
        }
    }

    fn count(image: &Image<bool>) -> usize {
        image.data.iter().filter(|&&x| x).count()
    }

    #[test]
    fn a_hole_a_jump_and_distrust_are_edges_and_the_border_is_none() {
        let camera = camera(64, 48);
        let plain = Surfaces::of(&wall(camera, |_, _| 2000), Sensor::Kinect).unwrap();
        assert_eq!(count(&plain.interior), 64 * 48);
        for code in [0, 5000] {
            let hole = |x, y| if (x, y) == (30, 20) { code } else { 2000 };
            let holed = Surfaces::of(&wall(camera, hole), Sensor::Kinect).unwrap();
            // The neighbours of the hole are edges too, so their squares count as well.
            assert_eq!(count(&holed.interior), 64 * 48 - (13 * 13 - 4), "code {code}");
            assert_eq!(*holed.z.at(30, 20), 0.0);
        }
        let step =
            Surfaces::of(&wall(camera, |x, _| if x < 30 { 2000 } else { 2080 }), Sensor::Kinect)
                .unwrap();
        assert_eq!(count(&step.interior), (64 - 12) * 48);
        let slope =
            Surfaces::of(&wall(camera, |x, _| 2000 + 60 * x as u16 / 2), Sensor::Kinect).unwrap();
        assert_eq!(count(&slope.interior), 64 * 48, "a slope of 60 mm in two pixels is no jump");
    }

    #[test]
    fn what_shines_through_is_no_surface() {
        let mut frame = wall(camera(64, 48), |_, _| 2000);
        Arc::make_mut(&mut frame.color).data[0][3] = 254;
        let found = Surfaces::of(&frame, Sensor::Kinect).unwrap();
        assert_eq!((found.z.data[0], found.z.data[1]), (0.0, 2.0));
    }

    /// From half the distance, the middle half of the wall fills the image.
    #[test]
    fn another_camera_sees_the_same_surfaces() {
        let here = camera(64, 48);
        let frame = wall(here, |x, y| if (24..40).contains(&x) && y < 24 { 0 } else { 2000 });
        let surfaces = Surfaces::of(&frame, Sensor::Kinect).unwrap();
        assert_eq!(surfaces.median_interior_z(), Some(2.0));
        let half = Camera { pose: here.pose.attached_camera(DVec3::Z, DQuat::IDENTITY), ..here };
        let seen = surfaces.project_into(&half, 0.2);
        for row in 0..48 {
            for column in 0..64 {
                let z = *seen.z.at(column, row);
                // The hole is twice as wide, and squares with a corner in it are missing.
                let is_hole = (15..49).contains(&column) && row < 25;
                let expected = if is_hole { 0.0 } else { 1.0 };
                assert!((z - expected).abs() < 1e-5, "{column} {row}: {z}");
            }
        }
        assert!(!seen.interior.at(49 + 5, 10) && *seen.interior.at(49 + 13, 10));
        let outside =
            seen.interior.data.iter().zip(&seen.z.data).filter(|(i, z)| **i && **z == 0.0);
        assert_eq!(outside.count(), 0);
    }

    /// Near surfaces occlude far ones, and grow faster when the camera approaches.
    #[test]
    fn the_nearest_surface_wins() {
        let here = camera(64, 48);
        let post = |x: usize, _| if (28..36).contains(&x) { 1000 } else { 2000 };
        let surfaces = Surfaces::of(&wall(here, post), Sensor::Kinect).unwrap();
        let closer =
            Camera { pose: here.pose.attached_camera(0.5 * DVec3::Z, DQuat::IDENTITY), ..here };
        let seen = surfaces.project_into(&closer, 0.2);
        // Pixel centres of the post at ±3.5 move to ±7; it occludes those of the wall at ±4.5 to ±6.
        let expected = |x| if (25..39).contains(&x) { 0.5 } else { 1.5 };
        assert!((0..64).all(|x| (*seen.z.at(x, 24) - expected(x)).abs() < 1e-5));
        assert_eq!(seen.depth_of_kind(DepthKind::Z), seen.z);
        let along = *seen.depth_of_kind(DepthKind::RayDistance).at(0, 0);
        assert!((along - 1.5 * here.intrinsics.ray(0, 0).length() as f32).abs() < 1e-5);
        assert!(surfaces.project_into(&closer, 0.6).z.data.iter().all(|&z| z == 0.0 || z > 1.4));
    }
}
