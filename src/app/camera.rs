//! The camera people steer: orbit, pan, dolly, frame.

use super::state::HomeView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::orbit::Orbit;
use crate::model::splats::Framing;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

/// A viewport's camera.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCamera {
    orbit: Orbit,
    /// Vertical field of view, radians: a wider window shows more at the sides.
    fov_y: f64,
    /// Size of the scene, world units: bounds how near and far one can dolly.
    radius: f64,
}

/// Range of the vertical field of view, radians.
const FOV_Y: [f64; 2] = [0.5, 1.3];
/// Wheel points that halve the distance.
const WHEEL_PER_HALVING: f64 = 240.0;
/// Nearest and farthest distance from the target, in scene radii.
const DISTANCE: [f64; 2] = [1e-3, 50.0];
/// How close to the poles dragging goes, radians.
const MAX_ELEVATION: f64 = FRAC_PI_2 - 0.01;

impl ViewCamera {
    /// The view a scene is opened with.
    pub fn home(home: &HomeView) -> Self {
        let k = &home.camera.intrinsics;
        let fov_y = 2.0 * (0.5 * k.height as f64 / k.fy).atan();
        let distance = home.camera.pose.centre().distance(home.target);
        Self {
            orbit: Orbit::from_pose(&home.camera.pose, home.up, distance.max(1e-9)),
            fov_y: fov_y.clamp(FOV_Y[0], FOV_Y[1]),
            radius: home.radius,
        }
    }

    /// Turns about the target; a drag over the height of the viewport is half a turn.
    pub fn turn(&mut self, delta_px: [f64; 2], height_px: f64) {
        let per_pixel = PI / height_px.max(1.0);
        self.orbit.azimuth -= delta_px[0] * per_pixel;
        let elevation = self.orbit.elevation + delta_px[1] * per_pixel;
        self.orbit.elevation = elevation.clamp(-MAX_ELEVATION, MAX_ELEVATION);
    }

    /// Shifts the target so that it follows the pointer.
    pub fn pan(&mut self, delta_px: [f64; 2], height_px: f64) {
        let per_pixel = 2.0 * self.orbit.distance * (0.5 * self.fov_y).tan() / height_px.max(1.0);
        let rotation = self.orbit.pose().rotation();
        let shift = rotation.x_axis * delta_px[0] + rotation.y_axis * delta_px[1];
        self.orbit.target -= shift * per_pixel;
    }

    /// Moves towards the target (positive wheel points) or away from it.
    pub fn dolly(&mut self, wheel_points: f64) {
        let distance = self.orbit.distance * 0.5f64.powf(wheel_points / WHEEL_PER_HALVING);
        self.orbit.distance = distance.clamp(DISTANCE[0] * self.radius, DISTANCE[1] * self.radius);
    }

    /// Looks at the whole scene from where it looks now.
    pub fn frame(&mut self, framing: &Framing) {
        self.orbit.target = framing.centre;
        self.orbit.distance = framing.distance(self.fov_y);
    }

    /// The camera for a viewport of this size in pixels.
    pub fn camera(&self, [width, height]: [u32; 2]) -> Camera {
        let half_width = (0.5 * self.fov_y).tan() * width as f64 / height as f64;
        let intrinsics = Intrinsics::from_horizontal_fov(width, height, 2.0 * half_width.atan());
        Camera { intrinsics, pose: self.orbit.pose() }
    }

    /// Point turned about.
    pub fn target(&self) -> DVec3 {
        self.orbit.target
    }

    /// Size of the scene, world units.
    pub fn radius(&self) -> f64 {
        self.radius
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::pose::Pose;

    fn start() -> ViewCamera {
        let pose = Pose::look_at(DVec3::new(4.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z).unwrap();
        let camera = Camera { intrinsics: Intrinsics::from_horizontal_fov(400, 400, 0.7), pose };
        ViewCamera::home(&HomeView { camera, up: DVec3::Z, target: DVec3::ZERO, radius: 1.5 })
    }

    #[test]
    fn home_is_the_dataset_camera() {
        let camera = start().camera([400, 400]);
        assert!((camera.pose.centre() - DVec3::new(4.0, 0.0, 1.0)).length() < 1e-9);
        assert!((camera.intrinsics.fov_x() - 0.7).abs() < 1e-9);
    }

    #[test]
    fn panning_keeps_the_target_under_the_pointer() {
        let mut view = start();
        let target = view.target();
        view.pan([40.0, -25.0], 400.0);
        let (pixel, _) = view.camera([400, 400]).project(target);
        assert!((pixel.x - 240.0).abs() < 1e-6 && (pixel.y - 175.0).abs() < 1e-6, "{pixel}");
    }

    #[test]
    fn turning_and_dollying_keep_the_target_centred() {
        let mut view = start();
        view.turn([120.0, 500.0], 400.0);
        view.dolly(240.0);
        let camera = view.camera([400, 400]);
        let (pixel, z) = camera.project(view.target());
        assert!((pixel.x - 200.0).abs() < 1e-6 && (pixel.y - 200.0).abs() < 1e-6);
        assert!((z - 0.5 * 17f64.sqrt()).abs() < 1e-9);
        for _ in 0..100 {
            view.dolly(1000.0);
        }
        assert!(view.camera([400, 400]).project(view.target()).1 > 0.0);
    }
}
