//! Reference for the alignment of a frame: brightness and depth of the scene, rendered from a pose.
//!
//! The rendered picture is wider than a frame, so that it overlaps with the frame even if the camera
//! has turned. This is possible because the scene covers more than the previous frame.

use super::samples::{LEVELS, brightness};
use crate::math::camera::{Camera, Intrinsics};
use crate::math::image::Image;
use crate::math::pose::Pose;
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::CpuRenderer;
use crate::render::{Exposing, RenderMethod, RenderOptions};
use glam::DVec3;

/// Minimum coverage at which a rendered pixel is valid.
const MIN_COVERAGE: f32 = 0.5;
/// Maximum relative difference between neighbouring depths on one surface; a larger difference is an
/// edge.
const EDGE: f64 = 0.1;

/// The scene rendered from a pose at several resolutions, finest first.
pub struct Reference {
    pub pose: Pose,
    pub levels: [ReferenceLevel; LEVELS],
}

/// One resolution level of a [`Reference`].
pub struct ReferenceLevel {
    intrinsics: Intrinsics,
    /// Brightness, and depth along the optical axis in world units. Depth is 0 where the scene is empty.
    texels: Image<[f64; 2]>,
}

/// Brightness and depth of the rendered scene at a point, interpolated, with their gradients.
#[derive(Clone, Copy)]
pub struct Texel {
    /// Brightness in `[0, 1]`, in the scene's exposure.
    pub brightness: f64,
    /// Depth along the optical axis, world units.
    pub depth: f64,
    /// Gradient of brightness with respect to the point's position in the camera's frame, per world
    /// unit.
    pub brightness_slope: DVec3,
    /// Gradient of depth with respect to the point's position in the camera's frame.
    pub depth_slope: DVec3,
}

impl Reference {
    /// Renders the scene from `pose` for frames with the given intrinsics. One rendered pixel covers
    /// `block` by `block` pixels of a frame. The margin on each side is `margin` times the frame's size.
    pub fn draw(
        renderer: &mut CpuRenderer,
        scene: SplatView<'_>,
        pose: &Pose,
        frame: &Intrinsics,
        block: usize,
        margin: f64,
    ) -> Self {
        let intrinsics = widened(frame, block, margin);
        let options = RenderOptions {
            // The fit estimates the frame's brightness itself.
            exposure_mode: Exposing::Neutral,
            near: 0.0,
            ..RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3])
        };
        let drawn = renderer.render(scene, &Camera { intrinsics, pose: *pose }, &options);
        let pixels = drawn.color.data.iter().zip(&drawn.coverage.data).zip(&drawn.depth.data);
        let texel = |((color, coverage), depth): ((&[f32; 3], &f32), &f32)| {
            let is_shown = *coverage >= MIN_COVERAGE && *depth > 0.0;
            match is_shown {
                // Drawn over black: dividing by coverage restores the brightness of the surface.
                true => [brightness(*color) / f64::from(*coverage), f64::from(*depth)],
                false => [0.0; 2],
            }
        };
        let (width, height) = (drawn.color.width, drawn.color.height);
        let texels = Image::from_vec(width, height, pixels.map(texel).collect());
        let finest = ReferenceLevel { intrinsics, texels };
        let middle = finest.halved();
        let coarsest = middle.halved();
        Self { pose: *pose, levels: [finest, middle, coarsest] }
    }
}

fn widened(frame: &Intrinsics, block: usize, margin: f64) -> Intrinsics {
    let per_pixel = 1.0 / block as f64;
    // Whole blocks on either side, and sizes that can be halved twice.
    let side = |length: u32| {
        let added = (margin * f64::from(length) * per_pixel).ceil();
        let side = (f64::from(length) * per_pixel).ceil() + 2.0 * added;
        let multiple = f64::from(1u32 << (LEVELS - 1));
        (added, ((side / multiple).ceil() * multiple) as u32)
    };
    let ((left, width), (top, height)) = (side(frame.width), side(frame.height));
    Intrinsics {
        width,
        height,
        fx: frame.fx * per_pixel,
        fy: frame.fy * per_pixel,
        cx: frame.cx * per_pixel + left,
        cy: frame.cy * per_pixel + top,
    }
}

impl ReferenceLevel {
    /// Returns the next coarser level. In each block of 2×2 pixels, those that show the nearest surface
    /// are averaged.
    fn halved(&self) -> Self {
        let (width, height) = (self.texels.width / 2, self.texels.height / 2);
        let texel = |i: usize| {
            let (column, row) = (2 * (i % width), 2 * (i / width));
            let four = [(0, 0), (1, 0), (0, 1), (1, 1)]
                .map(|(dx, dy)| *self.texels.at(column + dx, row + dy));
            // Depths of two surfaces would average to a place where there is none.
            let nearest = four.iter().map(|texel| texel[1]).filter(|z| *z > 0.0);
            // The nearest surface, which hides the others.
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            let same = four.iter().filter(|t| t[1] > 0.0 && t[1] <= nearest * (1.0 + EDGE));
            let (sum, n) = same.fold(([0.0; 2], 0.0), |(sum, n), texel| {
                ([sum[0] + texel[0], sum[1] + texel[1]], n + 1.0)
            });
            if n >= 2.0 { sum.map(|sum| sum / n) } else { [0.0; 2] }
        };
        let texels = Image::from_vec(width, height, (0..width * height).map(texel).collect());
        let Intrinsics { fx, fy, cx, cy, .. } = self.intrinsics;
        let intrinsics = Intrinsics {
            width: width as u32,
            height: height as u32,
            fx: 0.5 * fx,
            fy: 0.5 * fy,
            cx: 0.5 * cx,
            cy: 0.5 * cy,
        };
        Self { intrinsics, texels }
    }

    /// Returns the angle that a pixel at the centre of the picture covers, radians.
    pub fn pixel_angle(&self) -> f64 {
        1.0 / self.intrinsics.fx
    }

    /// Projects a point in the camera's frame to pixel coordinates. The origin of the coordinates is
    /// `rim` pixels from the left and upper borders. `None` if the projection is outside the picture or
    /// within `rim` pixels of its border.
    fn project(&self, point: DVec3, rim: f64) -> Option<(f64, f64)> {
        let k = &self.intrinsics;
        let (u, v) = (k.fx * point.x / point.z + k.cx - rim, k.fy * point.y / point.z + k.cy - rim);
        let is_inside = point.z > 0.0
            && (0.0..f64::from(k.width) - 2.0 * rim).contains(&u)
            && (0.0..f64::from(k.height) - 2.0 * rim).contains(&v);
        is_inside.then_some((u, v))
    }

    /// Returns brightness and depth of the pixel nearest to a point in the camera's frame. Depth is 0
    /// where the scene is empty. `None` if the point is outside the picture.
    pub fn nearest(&self, point: DVec3) -> Option<[f64; 2]> {
        let (u, v) = self.project(point, 0.0)?;
        Some(*self.texels.at(u as usize, v as usize))
    }

    /// Interpolates the picture bilinearly at a point in the camera's frame. `None` if the point is
    /// outside the picture, next to an empty pixel, or at a depth edge.
    pub fn at(&self, point: DVec3) -> Option<Texel> {
        let k = &self.intrinsics;
        // Texels are centred half a pixel from their corners.
        let (u, v) = self.project(point, 0.5)?;
        let (column, row) = (u as usize, v as usize);
        let (a, b) = (u - column as f64, v - row as f64);
        let four =
            [(0, 0), (1, 0), (0, 1), (1, 1)].map(|(dx, dy)| *self.texels.at(column + dx, row + dy));
        let near = four.iter().fold(f64::INFINITY, |near, texel| near.min(texel[1]));
        let far = four.iter().fold(0.0, |far: f64, texel| far.max(texel[1]));
        if !(near > 0.0 && far <= near * (1.0 + EDGE)) {
            return None;
        }
        let mix = |i: usize| {
            let [top, below] = [0, 2].map(|at| four[at][i] + a * (four[at + 1][i] - four[at][i]));
            let across = (1.0 - b) * (four[1][i] - four[0][i]) + b * (four[3][i] - four[2][i]);
            // Gradient of the projection x/z, y/z.
            let along_u = DVec3::new(k.fx, 0.0, -k.fx * point.x / point.z) / point.z;
            let along_v = DVec3::new(0.0, k.fy, -k.fy * point.y / point.z) / point.z;
            (top + b * (below - top), across * along_u + (below - top) * along_v)
        };
        let ((brightness, brightness_slope), (depth, depth_slope)) = (mix(0), mix(1));
        Some(Texel { brightness, depth, brightness_slope, depth_slope })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn references_are_wider_than_frames_by_whole_blocks() {
        let frame =
            Intrinsics { width: 640, height: 480, fx: 500.0, fy: 400.0, cx: 310.0, cy: 250.0 };
        let expected =
            Intrinsics { width: 192, height: 144, fx: 125.0, fy: 100.0, cx: 93.5, cy: 74.5 };
        assert_eq!(widened(&frame, 4, 0.1), expected);
        // 34 blocks and 4 on either side make 42; 17 and 2 make 21.
        let odd = widened(&Intrinsics { width: 100, height: 50, ..frame }, 3, 0.1);
        assert_eq!((odd.width, odd.height), (44, 24));
    }

    #[test]
    fn halves_show_the_nearest_of_four_texels() {
        let texels = [
            [[0.2, 2.0], [0.4, 2.1], [0.1, 1.0], [0.3, 1.2]],
            [[0.6, 2.0], [0.9, 2.9], [0.5, 1.05], [0.7, 0.0]],
        ];
        let intrinsics = Intrinsics { width: 4, height: 2, fx: 8.0, fy: 6.0, cx: 2.0, cy: 1.0 };
        let texels = Image::from_vec(4, 2, texels.into_iter().flatten().collect());
        let halved = ReferenceLevel { intrinsics, texels }.halved();
        let expected = Intrinsics { width: 2, height: 1, fx: 4.0, fy: 3.0, cx: 1.0, cy: 0.5 };
        assert_eq!(halved.intrinsics, expected);
        for (found, expected) in halved.texels.data.iter().zip([[0.4, 6.1 / 3.0], [0.3, 1.025]]) {
            assert!((0..2).all(|i| (found[i] - expected[i]).abs() < 1e-12), "{found:?}");
        }
        assert_eq!(halved.pixel_angle(), 0.25);
    }

    #[test]
    fn slopes_are_those_of_the_interpolated_picture() {
        let intrinsics = Intrinsics { width: 2, height: 2, fx: 3.0, fy: 4.0, cx: 0.75, cy: 1.25 };
        let texels = vec![[0.2, 2.0], [0.5, 2.1], [0.9, 2.05], [0.1, 1.95]];
        let level = ReferenceLevel { intrinsics, texels: Image::from_vec(2, 2, texels) };
        let values = |point: DVec3| level.at(point).map(|t| [t.brightness, t.depth]).unwrap();
        let (point, step) = (DVec3::new(0.2, -0.15, 2.0), 1e-6);
        let texel = level.at(point).unwrap();
        for (axis, unit) in DVec3::AXES.into_iter().enumerate() {
            let (after, before) = (values(point + step * unit), values(point - step * unit));
            let slopes = [texel.brightness_slope[axis], texel.depth_slope[axis]];
            for i in 0..2 {
                let slope = (after[i] - before[i]) / (2.0 * step);
                assert!((slopes[i] - slope).abs() < 1e-6, "{axis} {i}: {slope} {slopes:?}");
            }
        }
    }
}
