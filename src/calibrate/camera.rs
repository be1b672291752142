//! Colour camera as a parameter vector: offset across the optical axis, roll, focal length and principal
//! point.
//!
//! Both focal lengths share one factor, parameterised by its logarithm so that it stays positive for any
//! step.

use crate::dataset::calibration::ColorCamera;
use crate::math::camera::Intrinsics;
use glam::{DMat3, DQuat, DVec3};

pub(super) const N: usize = 6;
/// Index of the logarithm of the common focal length factor.
pub(super) const FOCAL: usize = 3;
pub(super) const ROLL: usize = 2;

/// Colour camera and its parameters relative to the initial camera of the search. Offset along the
/// optical axis, pitch and yaw are fixed. Over a scene's depth range, their effects hardly differ from
/// those of focal length and principal point.
#[derive(Clone, Copy, Debug)]
pub(super) struct CameraUnknowns {
    start: ColorCamera,
    /// Offset x and y (world units), roll relative to the initial camera (radians), logarithm of the
    /// focal length factor, and principal point (pixels).
    pub values: [f64; N],
}

impl CameraUnknowns {
    pub fn of(start: ColorCamera) -> Self {
        let ([x, y, _], [cx, cy]) = (start.offset, start.principal);
        Self { start, values: [x, y, 0.0, 0.0, cx, cy] }
    }

    pub fn parameters_of(&self, other: &ColorCamera) -> [f64; N] {
        let ([x, y, _], [cx, cy]) = (other.offset, other.principal);
        // A difference of rotation vectors, accurate because these rotations are small.
        let roll = other.rotation[2] - self.start.rotation[2];
        // Both focal lengths share the factor, so one axis suffices.
        [x, y, roll, (other.focal[0] / self.start.focal[0]).ln(), cx, cy]
    }

    pub fn camera(&self) -> ColorCamera {
        let [x, y, roll, growth, cx, cy] = self.values;
        let turned = DQuat::from_scaled_axis(DVec3::from_array(self.start.rotation));
        // Without roll the initial rotation is returned exactly, without rounding.
        let rotation = match roll == 0.0 {
            true => self.start.rotation,
            false => (turned * DQuat::from_rotation_z(roll)).to_scaled_axis().to_array(),
        };
        ColorCamera {
            // One factor for both axes preserves the pixel aspect ratio.
            focal: self.start.focal.map(|f| f * growth.exp()),
            principal: [cx, cy],
            offset: [x, y, self.start.offset[2]],
            rotation,
            size: self.start.size,
        }
    }
}

/// Returns the colour camera of photographs that are registered to the depth image: the depth camera
/// itself.
pub(super) fn registered(depth: &Intrinsics) -> ColorCamera {
    ColorCamera {
        focal: [depth.fx, depth.fy],
        principal: [depth.cx, depth.cy],
        offset: [0.0; 3],
        rotation: [0.0; 3],
        size: None,
    }
}

pub(super) struct Projector {
    turn: DMat3,
    offset: DVec3,
    focal: [f64; 2],
    principal: [f64; 2],
}

pub(super) struct ProjectedPoint {
    pub at: [f64; 2],
    pub jacobian: [[f64; N]; 2],
    /// Derivatives of the pixel's x and y with respect to the point's position in the depth camera's
    /// frame.
    pub position_jacobian: [DVec3; 2],
}

impl Projector {
    pub fn new(unknowns: &CameraUnknowns) -> Self {
        let ColorCamera { focal, principal, offset, rotation, .. } = unknowns.camera();
        let turn = DQuat::from_scaled_axis(DVec3::from_array(rotation)).inverse();
        Self { turn: DMat3::from_quat(turn), offset: DVec3::from_array(offset), focal, principal }
    }

    /// Projects a point of the depth camera's frame to the colour image. Returns `None` if the point is
    /// behind the colour camera.
    #[inline]
    pub fn project(&self, point: DVec3) -> Option<ProjectedPoint> {
        let p = self.turn * (point - self.offset);
        if p.z <= 0.0 {
            return None;
        }
        let slant = [p.x / p.z, p.y / p.z];
        let mut projected = ProjectedPoint {
            at: [0.0; 2],
            jacobian: [[0.0; N]; 2],
            position_jacobian: [DVec3::ZERO; 2],
        };
        for i in 0..2 {
            let from_centre = self.focal[i] * slant[i];
            projected.at[i] = from_centre + self.principal[i];
            let mut by_place = DVec3::ZERO;
            by_place[i] = self.focal[i] / p.z;
            by_place.z = -from_centre / p.z;
            let by_point = self.turn.transpose() * by_place;
            // Rotating the camera rotates points the other way: dp = p × ẑ.
            let by_roll = by_place.dot(p.cross(DVec3::Z));
            projected.jacobian[i] = [-by_point.x, -by_point.y, by_roll, from_centre, 0.0, 0.0];
            projected.jacobian[i][4 + i] = 1.0;
            projected.position_jacobian[i] = by_point;
        }
        Some(projected)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted() -> CameraUnknowns {
        let camera = ColorCamera { rotation: [0.05, -0.08, 0.2], ..ColorCamera::KINECT };
        let mut unknowns = CameraUnknowns::of(camera);
        unknowns.values[ROLL] = -0.1;
        unknowns.values[FOCAL] = 0.07;
        unknowns
    }

    #[test]
    fn points_appear_where_the_camera_says() {
        for unknowns in [CameraUnknowns::of(ColorCamera::KINECT), tilted()] {
            let point = DVec3::new(0.4, -0.3, 1.7);
            let projected = Projector::new(&unknowns).project(point).unwrap();
            let expected = unknowns.camera().project(point).unwrap().to_array();
            assert!((0..2).all(|i| (projected.at[i] - expected[i]).abs() < 1e-9));
            assert!(Projector::new(&unknowns).project(-point).is_none());
        }
    }

    #[test]
    fn slopes_are_those_of_finite_differences() {
        let point = DVec3::new(0.4, -0.3, 1.7);
        let unknowns = tilted();
        let projected = Projector::new(&unknowns).project(point).unwrap();
        let step = 1e-6;
        for j in 0..N {
            let at = |sign: f64| {
                let mut moved = unknowns;
                moved.values[j] += sign * step;
                Projector::new(&moved).project(point).unwrap().at
            };
            let (low, high) = (at(-1.0), at(1.0));
            for i in 0..2 {
                let expected = (high[i] - low[i]) / (2.0 * step);
                let error = (projected.jacobian[i][j] - expected).abs();
                assert!(error < 1e-5 * expected.abs().max(1.0), "{j}: {expected}");
            }
        }
    }

    #[test]
    fn the_start_comes_back_as_it_was() {
        let camera = ColorCamera { rotation: [0.05, -0.08, 0.2], ..ColorCamera::KINECT };
        assert_eq!(CameraUnknowns::of(camera).camera(), camera);
    }
}
