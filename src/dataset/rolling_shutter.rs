//! Rolling shutter: images read row by row while the camera rotates.
//!
//! A Kinect v1 needs most of the time between two frames to read one (Ringaby and Forssén, "Scan
//! rectification for structured light range sensors with rolling shutters", ICCV 2011). At 65° a second,
//! the camera rotates by two degrees, or 18 pixels, between the first and the last row. Rows are resampled
//! to the time of the middle row: along `d + τ ω×d` for a row's ray `d`, with `τ` the row's time after the
//! middle row and `ω` the angular velocity. Translation is neglected: at 2 m, 20 cm a second are one pixel.

use crate::math::camera::Intrinsics;
use glam::{DVec2, DVec3};

/// Readout time of a Kinect v1 photograph, seconds.
pub(super) const KINECT_COLOR: f64 = 0.0261;
/// Readout time of a Kinect v1 depth image, seconds.
pub(super) const KINECT_DEPTH: f64 = 0.0305;

/// Camera rotation during the readout of an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RollingShutter {
    /// Rotation vector from the first to the last row, radians, in camera axes (x right, y down).
    pub rotation: DVec3,
}

impl RollingShutter {
    /// True if every row is displaced by less than half a pixel.
    pub fn is_negligible(&self, k: &Intrinsics) -> bool {
        self.rotation.length() * k.fx.max(k.fy) < 1.0
    }

    /// Direction (x/z, y/z) at which a row recorded what the camera sees along `slope` at the time of the
    /// middle row, and the factor on depth along the optical axis measured there.
    pub fn source_direction(&self, k: &Intrinsics, slope: DVec2) -> (DVec2, f64) {
        let ray = slope.extend(1.0);
        let across = self.rotation.cross(ray);
        // The row depends on the unknown direction; the estimate is exact to second order in the rotation.
        let rows = 1.0 / f64::from(k.height);
        let middle = (slope.y * k.fy + k.cy) * rows - 0.5;
        let row = middle / (1.0 + k.fy * rows * (across.y - slope.y * across.z));
        let seen = ray - row * across;
        let factor = 1.0 / seen.z;
        (factor * seen.truncate(), factor)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    #[test]
    fn a_row_saw_what_a_camera_turned_by_its_time_sees() {
        let k = Intrinsics::from_horizontal_fov(640, 480, 1.0);
        let shutter = RollingShutter { rotation: DVec3::new(0.01, -0.03, 0.02) };
        assert!(!shutter.is_negligible(&k) && RollingShutter::default().is_negligible(&k));
        for slope in [DVec2::new(0.3, -0.35), DVec2::new(-0.2, 0.3), DVec2::new(0.4, 0.0)] {
            let (at, factor) = shutter.source_direction(&k, slope);
            let row = (at.y * k.fy + k.cy) / f64::from(k.height) - 0.5;
            // A point that the row recorded 2 units ahead, in the axes of the middle row's camera.
            let turned = DQuat::from_scaled_axis(row * shutter.rotation) * (2.0 * at.extend(1.0));
            assert!((turned.truncate() / turned.z - slope).length() < 3e-4, "{turned}");
            assert!((2.0 * factor - turned.z).abs() < 1e-3, "{factor} {turned}");
        }
    }
}
