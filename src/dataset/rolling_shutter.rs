//! Images read row by row by a camera that turns meanwhile.
//!
//! A Kinect of the first kind takes most of the time between two frames to read one (Ringaby and Forssén,
//! "Scan rectification for structured light range sensors with rolling shutters", ICCV 2011). A camera
//! that turns by 65° a second turns by two degrees between the first row and the last, or 18 pixels.
//! What a row shows is taken for what the camera saw at the time of the middle row: along the ray
//! `d + τ ω×d` of its own ray `d`, with `τ` the row's time after the middle's and `ω` the rate of turning.
//! How far the camera moved meanwhile is left out: at two metres 20 cm a second are a pixel.

use crate::math::camera::Intrinsics;
use glam::{DVec2, DVec3};

/// Seconds in which a Kinect of the first kind reads a photograph.
pub(super) const KINECT_COLOR: f64 = 0.0261;
/// Seconds in which it reads a depth image.
pub(super) const KINECT_DEPTH: f64 = 0.0305;

/// How a camera turned while it read an image.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct RollingShutter {
    /// Axis times angle from the first row to the last, radians, in the camera's axes (x right, y down).
    pub turn: DVec3,
}

impl RollingShutter {
    /// Whether rows are less than half a pixel apart from where they belong.
    pub fn is_none(&self, k: &Intrinsics) -> bool {
        self.turn.length() * k.fx.max(k.fy) < 1.0
    }

    /// The slope along which a row saw what the camera sees along `slope` at the middle row's time; and
    /// the factor on a depth along the axis that was measured there.
    pub fn apply(&self, k: &Intrinsics, slope: DVec2) -> (DVec2, f64) {
        let ray = slope.extend(1.0);
        let across = self.turn.cross(ray);
        // The row itself follows from where it saw the ray: to second order in the turn.
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
        let shutter = RollingShutter { turn: DVec3::new(0.01, -0.03, 0.02) };
        assert!(!shutter.is_none(&k) && RollingShutter::default().is_none(&k));
        for slope in [DVec2::new(0.3, -0.35), DVec2::new(-0.2, 0.3), DVec2::new(0.4, 0.0)] {
            let (at, factor) = shutter.apply(&k, slope);
            let row = (at.y * k.fy + k.cy) / f64::from(k.height) - 0.5;
            // A point that the row saw 2 units ahead, in the axes of the middle's camera.
            let turned = DQuat::from_scaled_axis(row * shutter.turn) * (2.0 * at.extend(1.0));
            assert!((turned.truncate() / turned.z - slope).length() < 3e-4, "{turned}");
            assert!((2.0 * factor - turned.z).abs() < 1e-3, "{factor} {turned}");
        }
    }
}
