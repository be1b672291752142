//! Pinhole cameras. Pixel `(i, j)` (column, row) has its centre at `(i + ½, j + ½)`.

use super::pose::Pose;
use glam::{DVec2, DVec3};

/// Pinhole intrinsics in pixels.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Intrinsics {
    /// Image width, pixels.
    pub width: u32,
    /// Image height, pixels.
    pub height: u32,
    /// Horizontal focal length, pixels.
    pub fx: f64,
    /// Vertical focal length, pixels.
    pub fy: f64,
    /// Column of the principal point, pixels.
    pub cx: f64,
    /// Row of the principal point, pixels.
    pub cy: f64,
}

impl Intrinsics {
    /// Builds intrinsics with square pixels and a centred principal point from a horizontal field of
    /// view in radians.
    pub fn from_horizontal_fov(width: u32, height: u32, fov_x: f64) -> Self {
        let focal = 0.5 * width as f64 / (0.5 * fov_x).tan();
        Self {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * width as f64,
            cy: 0.5 * height as f64,
        }
    }

    /// Number of pixels of an image.
    pub fn n_pixels(&self) -> usize {
        self.width as usize * self.height as usize
    }

    /// Builds intrinsics with square pixels and a centred principal point from a vertical field of view
    /// in radians.
    pub fn from_vertical_fov(width: u32, height: u32, fov_y: f64) -> Self {
        let focal = 0.5 * height as f64 / (0.5 * fov_y).tan();
        // The field of view passed here is arbitrary: `fx` and `fy` are replaced.
        Self { fx: focal, fy: focal, ..Self::from_horizontal_fov(width, height, 1.0) }
    }

    /// Builds intrinsics of an equidistant fisheye lens with square pixels and a centred principal
    /// point.
    ///
    /// `fov_x` is in radians, up to 2π; the focal lengths are in pixels per radian.
    pub fn fisheye(width: u32, height: u32, fov_x: f64) -> Self {
        let focal = width as f64 / fov_x;
        // The field of view passed here is arbitrary: `fx` and `fy` are replaced.
        Self { fx: focal, fy: focal, ..Self::from_horizontal_fov(width, height, 1.0) }
    }

    /// Returns the horizontal field of view in radians.
    pub fn fov_x(&self) -> f64 {
        2.0 * (0.5 * self.width as f64 / self.fx).atan()
    }

    /// Returns the vertical field of view in radians.
    pub fn fov_y(&self) -> f64 {
        2.0 * (0.5 * self.height as f64 / self.fy).atan()
    }

    /// Returns intrinsics of the same view with the image scaled by `factor`. Width and height are
    /// rounded to whole pixels, at least 1.
    pub fn scaled(&self, factor: f64) -> Self {
        let width = ((self.width as f64 * factor).round() as u32).max(1);
        let height = ((self.height as f64 * factor).round() as u32).max(1);
        self.resized(width, height)
    }

    /// Returns intrinsics of the same view with an image of `width`×`height` pixels. Each axis is scaled
    /// by its own factor.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        let (sx, sy) = (width as f64 / self.width as f64, height as f64 / self.height as f64);
        Self {
            width,
            height,
            fx: self.fx * sx,
            fy: self.fy * sy,
            cx: self.cx * sx,
            cy: self.cy * sy,
        }
    }

    /// Returns the camera-space direction with `z = 1` through the centre of a pixel.
    #[inline]
    pub fn ray(&self, column: usize, row: usize) -> DVec3 {
        DVec3::new(
            (column as f64 + 0.5 - self.cx) / self.fx,
            (row as f64 + 0.5 - self.cy) / self.fy,
            1.0,
        )
    }
}

/// Pinhole camera with a pose.
///
/// ```
/// use glam::{DVec2, DVec3};
/// use vbgs_studio::math::camera::{Camera, Intrinsics};
/// use vbgs_studio::math::pose::Pose;
///
/// let intrinsics = Intrinsics::from_horizontal_fov(640, 480, 1.0);
/// let camera = Camera { intrinsics, pose: Pose::IDENTITY };
/// let (pixel, depth) = camera.project(DVec3::new(0.0, 0.0, 2.0));
/// assert_eq!((pixel, depth), (DVec2::new(320.0, 240.0), 2.0));
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Camera {
    /// Pinhole intrinsics.
    pub intrinsics: Intrinsics,
    /// Rigid transform from camera to world coordinates.
    pub pose: Pose,
}

impl Camera {
    /// Returns the pixel coordinates and the depth `z` of a world point. The coordinates are meaningless
    /// for `z ≤ 0`.
    pub fn project(&self, world: DVec3) -> (DVec2, f64) {
        let (rotation, translation) = self.pose.inverse();
        let p = rotation * world + translation;
        let k = &self.intrinsics;
        (DVec2::new(k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy), p.z)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn projecting_a_pixel_ray_returns_the_pixel_centre() {
        let camera = Camera {
            intrinsics: Intrinsics::from_horizontal_fov(64, 48, 0.9),
            pose: Pose::look_at(DVec3::new(1.0, 2.0, 0.5), DVec3::ZERO, DVec3::Z).unwrap(),
        };
        let world = camera.pose.transform_point(camera.intrinsics.ray(10, 40) * 2.5);
        let (pixel, z) = camera.project(world);
        assert!((pixel - DVec2::new(10.5, 40.5)).length() < 1e-10);
        assert!((z - 2.5).abs() < 1e-12);
        assert!((camera.intrinsics.fov_x() - 0.9).abs() < 1e-12);
    }

    #[test]
    fn scaling_keeps_the_view() {
        let k = Intrinsics::from_horizontal_fov(640, 480, 1.0);
        let half = k.scaled(0.5);
        assert_eq!((half.width, half.height), (320, 240));
        assert!((half.fov_x() - k.fov_x()).abs() < 1e-12);
        let k = Intrinsics { width: 640, height: 480, fx: 500.0, fy: 400.0, cx: 300.0, cy: 200.0 };
        let expected =
            Intrinsics { width: 320, height: 120, fx: 250.0, fy: 100.0, cx: 150.0, cy: 50.0 };
        assert_eq!(k.resized(320, 120), expected);
    }

    #[test]
    fn focal_lengths_follow_from_fields_of_view() {
        let fov_y = 2.0 * 0.5f64.atan();
        let k = Intrinsics::from_vertical_fov(640, 480, fov_y);
        let fisheye = Intrinsics::fisheye(640, 480, 2.5);
        for (found, expected) in [
            (k.fx, 480.0),
            (k.fy, 480.0),
            (k.fov_x(), 2.0 * (2.0f64 / 3.0).atan()),
            (k.fov_y(), fov_y),
            (fisheye.fx, 256.0),
            (fisheye.fy, 256.0),
        ] {
            assert!((found - expected).abs() < 1e-12 * expected, "{found} {expected}");
        }
    }
}
