//! Interactive viewport camera: orbits, pans, dollies, flies, and fits the scene into the viewport.

use super::state::HomeView;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::orbit::Orbit;
use crate::math::pose::Pose;
use crate::model::splat::framing::Framing;
use crate::render::Lens;
use glam::DVec3;
use std::f64::consts::{FRAC_PI_2, PI};

#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ViewCamera {
    pub orbit: Orbit,
    /// Default vertical field of view, radians; taken from the scene's home view or the last visited
    /// dataset camera.
    pub own_fov_y: f64,
    lens: Lens,
    /// Vertical field of view in use, radians. A wider window shows more at the sides.
    fov_y: f64,
    /// Scene radius, world units. Bounds the camera's distance from the target.
    pub radius: f64,
    middle: DVec3,
}

/// Allowed range of the default vertical field of view, radians.
const OWN_FOV_Y: [f64; 2] = [0.5, 1.3];
/// Largest horizontal or vertical field of view of a pinhole camera, radians (`rendering.md`, Wide views
/// and fisheye).
const MAX_PINHOLE_FOV: f64 = 150.0 / 180.0 * PI;
/// Largest and smallest field of view used to compute the camera distance at which the scene fits into the
/// viewport, radians.
// Without the smallest one, a very narrow window would move the camera far away.
const MAX_FRAMING_FOV: f64 = 2.0;
const MIN_FRAMING_FOV: f64 = 0.1;
/// Elevation of the camera in the overview of the scene, and the camera's turn from its current azimuth,
/// radians.
// Seen along the path of the cameras, their frusta would hide each other.
const OVERVIEW_ELEVATION: f64 = 0.5;
const OVERVIEW_TURN: f64 = 0.5;
/// Scroll distance that halves the camera's distance from the target, window points.
pub const WHEEL_PER_HALVING: f64 = 240.0;
/// Smallest and largest distance of the camera from the target, in scene radii.
const DISTANCE: [f64; 2] = [1e-3, 50.0];
/// Smallest and largest distance between the target and a dataset camera that the view moves to, in
/// scene radii.
const VISIT_DISTANCE: [f64; 2] = [0.2, 2.0];
/// Largest elevation reached by dragging, radians.
// At the poles the horizon is undefined.
const MAX_ELEVATION: f64 = FRAC_PI_2 - 0.01;

impl ViewCamera {
    pub fn home(home: &HomeView) -> Self {
        // An orbit needs a positive distance, and the target may coincide with the camera.
        let distance = home.camera.pose.centre().distance(home.target);
        let fov_y = own_fov_y(&home.camera.intrinsics);
        Self {
            orbit: Orbit::from_pose(&home.camera.pose, home.up, distance.max(1e-9)),
            own_fov_y: fov_y,
            lens: Lens::Pinhole,
            fov_y,
            radius: home.radius,
            middle: home.target,
        }
    }

    /// Moves to the pose of a dataset camera and orbits about a point in front of it.
    pub fn move_to_camera(&mut self, camera: &Camera) {
        let pose = &camera.pose;
        // The scene's centre may lie behind this camera; clamping keeps the target in front.
        let ahead = (self.middle - pose.centre()).dot(pose.forward());
        let [least, most] = VISIT_DISTANCE.map(|share| share * self.radius);
        self.orbit = Orbit::from_pose(pose, self.orbit.up, ahead.clamp(least, most).max(1e-9));
        // Otherwise the field of view would jump when the user leaves the dataset's camera.
        self.own_fov_y = own_fov_y(&camera.intrinsics);
    }

    /// Sets the lens and its vertical field of view, radians; `None` restores the scene's default.
    pub fn set_lens(&mut self, lens: Lens, fov_y: Option<f64>) {
        self.lens = lens;
        self.fov_y = fov_y.unwrap_or(self.own_fov_y);
    }

    /// Orbits about the target. A drag over the full height of the viewport turns the camera by 180
    /// degrees.
    pub fn orbit_by(&mut self, delta_px: [f64; 2], height_px: f64) {
        // At least 1: a viewport squeezed out by panels has no height.
        let per_pixel = PI / height_px.max(1.0);
        self.orbit.azimuth -= delta_px[0] * per_pixel;
        let elevation = self.orbit.elevation + delta_px[1] * per_pixel;
        self.orbit.elevation = elevation.clamp(-MAX_ELEVATION, MAX_ELEVATION);
    }

    pub fn pan(&mut self, delta_px: [f64; 2], size_px: [f64; 2]) {
        // Points at the distance of the target follow the pointer.
        let per_pixel = self.orbit.distance / self.focal(size_px);
        let rotation = self.orbit.pose().rotation();
        let shift = rotation.x_axis * delta_px[0] + rotation.y_axis * delta_px[1];
        self.orbit.target -= shift * per_pixel;
    }

    /// Moves towards the target for positive scroll distances (points), away from it otherwise.
    pub fn dolly(&mut self, wheel_points: f64) {
        let distance = self.orbit.distance * 0.5f64.powf(wheel_points / WHEEL_PER_HALVING);
        self.orbit.distance = distance.clamp(DISTANCE[0] * self.radius, DISTANCE[1] * self.radius);
    }

    /// Translates camera and target by `[right, down, ahead]` along the camera axes, in scene radii.
    pub fn fly(&mut self, [right, down, ahead]: [f64; 3]) {
        let pose = self.orbit.pose();
        let rotation = pose.rotation();
        let way = rotation.x_axis * right + rotation.y_axis * down + pose.forward() * ahead;
        self.orbit.target += way * self.radius;
    }

    /// Sets the orbit's target and turns the camera towards it without moving the camera.
    pub fn set_target(&mut self, point: DVec3) {
        let eye = self.orbit.pose().centre();
        if let Some(pose) = Pose::look_at(eye, point, self.orbit.up) {
            // An orbit needs a positive distance.
            self.orbit = Orbit::from_pose(&pose, self.orbit.up, eye.distance(point).max(1e-9));
        }
    }

    pub fn set_view_direction(&mut self, direction: DVec3) {
        let eye = self.orbit.target - direction * self.orbit.distance;
        // Straight down, the horizon is undefined. A small offset from the pole keeps the heading, or the
        // picture's up direction if the camera already looks down.
        let rotation = self.orbit.pose().rotation();
        let level = [rotation.z_axis, -rotation.y_axis].map(|axis| axis.reject_from(direction));
        let ahead = if level[0].length() > 0.1 { level[0] } else { level[1] }.normalize_or_zero();
        let is_upright = direction.cross(self.orbit.up).length() < 1e-6;
        let eye = if is_upright { eye - ahead * 1e-3 * self.orbit.distance } else { eye };
        if let Some(pose) = Pose::look_at(eye, self.orbit.target, self.orbit.up) {
            let distance = eye.distance(self.orbit.target);
            self.orbit = Orbit::from_pose(&pose, self.orbit.up, distance);
        }
    }

    /// Sets the up direction and levels the camera without moving it.
    pub fn set_up(&mut self, up: DVec3) {
        let pose = self.orbit.pose();
        self.orbit = Orbit::from_pose(&pose, up, self.orbit.distance);
    }

    /// Fits the whole scene into the viewport without changing the view direction.
    pub fn fit_scene(&mut self, framing: &Framing, size_px: [u32; 2]) {
        self.orbit.target = framing.centre;
        self.orbit.distance = framing.distance(self.narrower_fov(size_px));
    }

    /// Raises the camera, turns it sideways from the current azimuth, and fits the whole scene into the
    /// viewport.
    pub fn fit_scene_from_above(&mut self, framing: &Framing, size_px: [u32; 2]) {
        self.orbit.elevation = OVERVIEW_ELEVATION;
        self.orbit.azimuth += OVERVIEW_TURN;
        self.fit_scene(framing, size_px);
    }

    /// Returns the smaller of the horizontal and vertical field of view, radians, clamped to the range from
    /// [`MIN_FRAMING_FOV`] to [`MAX_FRAMING_FOV`]. A scene that fits into it is not cut off.
    fn narrower_fov(&self, [width, height]: [u32; 2]) -> f64 {
        let fov_y = self.fov_y.min(MAX_FRAMING_FOV);
        let aspect = (f64::from(width) / f64::from(height.max(1))).min(1.0);
        let fov_x = match self.lens {
            Lens::Pinhole => 2.0 * ((0.5 * fov_y).tan() * aspect).atan(),
            Lens::Fisheye => fov_y * aspect,
        };
        // The framing distance divides by the sine of half the angle, which is 0 for a 360° fisheye.
        fov_x.clamp(MIN_FRAMING_FOV, MAX_FRAMING_FOV)
    }

    pub fn camera(&self, [width, height]: [u32; 2]) -> Camera {
        let size = [f64::from(width), f64::from(height)];
        let focal = self.focal(size);
        let intrinsics = Intrinsics {
            width,
            height,
            fx: focal,
            fy: focal,
            cx: 0.5 * size[0],
            cy: 0.5 * size[1],
        };
        Camera { intrinsics, pose: self.orbit.pose() }
    }

    /// Returns the focal length in pixels; for a fisheye, in pixels per radian.
    fn focal(&self, [width, height]: [f64; 2]) -> f64 {
        match self.lens {
            Lens::Pinhole => {
                // In a wide window the horizontal field of view reaches the limit first, which reduces the
                // vertical one.
                let upright = 0.5 * height / (0.5 * self.fov_y).tan();
                upright.max(0.5 * width.max(height) / (0.5 * MAX_PINHOLE_FOV).tan())
            }
            Lens::Fisheye => height / self.fov_y,
        }
    }

    pub fn distance_to_middle(&self, camera: &Camera) -> f64 {
        camera.pose.centre().distance(self.middle)
    }
}

fn own_fov_y(k: &Intrinsics) -> f64 {
    let fov_y = 2.0 * (0.5 * f64::from(k.height) / k.fy).atan();
    fov_y.clamp(OWN_FOV_Y[0], OWN_FOV_Y[1])
}

#[cfg(test)]
mod tests {
    use super::*;

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
        for fov_y in [None, Some(2.5), Some(10.0)] {
            let mut view = start();
            view.set_lens(Lens::Pinhole, fov_y);
            let target = view.orbit.target;
            view.pan([40.0, -25.0], [600.0, 400.0]);
            let (pixel, _) = view.camera([600, 400]).project(target);
            assert!((pixel.x - 340.0).abs() < 1e-6 && (pixel.y - 175.0).abs() < 1e-6, "{pixel}");
        }
    }

    #[test]
    fn fields_of_view_are_what_was_asked_for_as_far_as_a_lens_goes() {
        let mut view = start();
        view.set_lens(Lens::Pinhole, Some(1.5));
        let k = view.camera([400, 400]).intrinsics;
        assert!((k.fov_x() - 1.5).abs() < 1e-9);
        view.set_lens(Lens::Pinhole, Some(MAX_PINHOLE_FOV));
        let k = view.camera([800, 400]).intrinsics;
        assert!((k.fov_x() - MAX_PINHOLE_FOV).abs() < 1e-9, "the limit holds horizontally");
        view.set_lens(Lens::Fisheye, Some(2.0 * PI));
        let k = view.camera([800, 400]).intrinsics;
        assert!(
            (k.fy * PI - 200.0).abs() < 1e-9,
            "the backward direction projects to the upper edge"
        );
    }

    #[test]
    fn a_visited_camera_is_looked_through() {
        let mut view = start();
        let pose = Pose::look_at(DVec3::new(-1.0, 3.0, 2.0), DVec3::X, DVec3::Z).unwrap();
        let intrinsics = Intrinsics::from_horizontal_fov(300, 300, 0.9);
        view.move_to_camera(&Camera { intrinsics, pose });
        view.set_lens(Lens::Pinhole, None);
        let camera = view.camera([300, 300]);
        assert!((camera.pose.centre() - pose.centre()).length() < 1e-9);
        assert!((camera.pose.forward() - pose.forward()).length() < 1e-9);
        assert!((camera.intrinsics.fov_x() - 0.9).abs() < 1e-9);
    }

    #[test]
    fn framing_fits_the_smaller_side_of_the_viewport() {
        let framing = Framing { centre: DVec3::ONE, radius: 1.0 };
        for size in [[800, 400], [400, 400], [200, 600]] {
            let mut view = start();
            view.fit_scene(&framing, size);
            let camera = view.camera(size);
            let (pose, k) = (camera.pose, camera.intrinsics);
            let distance = pose.centre().distance(framing.centre);
            // The sphere's silhouette lies at the angle whose sine is radius / distance.
            let rim = (1.0 / distance).asin().tan() * k.fx;
            let half = 0.5 * f64::from(size[0].min(size[1]));
            assert!((rim - half).abs() < 1e-6 * half, "{size:?}: {rim} of {half}");
        }
    }

    #[test]
    fn flying_goes_where_the_camera_looks_and_a_pivot_is_seen_in_the_middle() {
        let mut view = start();
        let before = view.camera([400, 400]).pose;
        view.fly([0.0, 0.0, 0.5]);
        let after = view.camera([400, 400]).pose;
        assert!((after.centre() - before.centre() - before.forward() * 0.75).length() < 1e-9);
        let point = DVec3::new(0.5, 0.4, -0.3);
        view.set_target(point);
        let camera = view.camera([400, 400]);
        assert!(
            (camera.pose.centre() - after.centre()).length() < 1e-9,
            "the camera does not move"
        );
        let (pixel, _) = camera.project(point);
        assert!((pixel.x - 200.0).abs() < 1e-6 && (pixel.y - 200.0).abs() < 1e-6, "{pixel}");
    }

    #[test]
    fn axes_are_looked_along_and_up_can_be_another() {
        let mut view = start();
        for axis in [DVec3::X, DVec3::NEG_Y, DVec3::NEG_Z] {
            view.set_view_direction(axis);
            let pose = view.camera([400, 400]).pose;
            // Straight down, the camera stops just before the pole.
            assert!(pose.forward().dot(axis) > 0.999, "{axis}: {}", pose.forward());
            assert!((view.orbit.target - DVec3::ZERO).length() < 1e-9);
        }
        view.set_up(DVec3::Y);
        view.set_view_direction(DVec3::X);
        let pose = view.camera([400, 400]).pose;
        assert!(pose.rotation().y_axis.dot(DVec3::Y) < -0.999, "y is up in the picture");
    }

    #[test]
    fn turning_and_dollying_keep_the_target_centred() {
        let mut view = start();
        view.orbit_by([120.0, 500.0], 400.0);
        view.dolly(240.0);
        let camera = view.camera([400, 400]);
        let (pixel, z) = camera.project(view.orbit.target);
        assert!((pixel.x - 200.0).abs() < 1e-6 && (pixel.y - 200.0).abs() < 1e-6);
        assert!((z - 0.5 * 17f64.sqrt()).abs() < 1e-9);
        for _ in 0..100 {
            view.dolly(1000.0);
        }
        assert!(view.camera([400, 400]).project(view.orbit.target).1 > 0.0);
    }
}
