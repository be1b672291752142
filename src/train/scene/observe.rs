//! Visibility of components in a frame: evidence for and against them (`scene.md`, Visibility counts).

use super::component_sums::{ComponentSums, Visibility};
use super::components::Seeds;
use crate::math::camera::Camera;
use crate::observation::surface::Observation;
use glam::{DMat3, DVec3};

const PARTS: usize = 64;

/// View of the scene from a frame's camera.
pub struct FrameView<'a> {
    frame: &'a Observation,
    rotation: DMat3,
    centre: DVec3,
    h: f64,
}

/// Updates the visibility counts of all components with one frame. A component that the frame measured
/// is a hit; a component in front of the measured surface is a miss. Hidden or unknown components are
/// not counted. `camera` is the frame's camera with the corrected pose, `h` the structural scale in
/// world units.
pub fn observe(
    component_sums: &mut ComponentSums,
    seeds: &Seeds,
    frame: &Observation,
    camera: &Camera,
    h: f64,
) {
    let viewer = FrameView::new(frame, camera, h);
    component_sums.for_each_part(PARTS, |first, rows, wide| {
        for (id, row) in (first..).zip(rows) {
            let (n, sum, normal) = wide.plane(id, row);
            // A free row, or a component without points.
            if n == 0.0 {
                continue;
            }
            let seed = DVec3::from_array(seeds.of(id).map(f64::from));
            let mean = seed + DVec3::from_array(sum) * (h / n);
            if let Some((visibility, expected)) = viewer.visibility(mean, DVec3::from_array(normal))
            {
                // A merged component can give the returns of all its seeds.
                row.count_visibility(visibility, expected * seeds.components.surface(id));
            }
        }
    });
}

impl<'a> FrameView<'a> {
    /// Creates the view of a frame taken by `camera`; `h` is the structural scale, world units.
    pub fn new(frame: &'a Observation, camera: &Camera, h: f64) -> Self {
        let pose = &camera.pose;
        let (rotation, centre) = (pose.rotation().transpose(), pose.centre() - frame.origin);
        Self { frame, rotation, centre, h }
    }

    /// True if the frame measured something behind a surface at `mean`, false if it measured the
    /// surface itself. `mean` is in world units from the origin. `None` if the surface is hidden, out
    /// of view or unknown.
    pub fn measures_through(&self, mean: DVec3) -> Option<bool> {
        let (visibility, _) = self.visibility(mean, DVec3::ZERO)?;
        Some(visibility == Visibility::Miss)
    }

    /// Returns the visibility of a component at `mean`, and the number of points expected on the
    /// component. `None` if the component is hidden, out of view or unknown.
    fn visibility(&self, mean: DVec3, normal: DVec3) -> Option<(Visibility, f64)> {
        let local = self.rotation * (mean - self.centre);
        // Behind the camera the projection would mirror the point.
        if local.z <= 0.0 {
            return None;
        }
        let k = &self.frame.camera.intrinsics;
        let (u, v) = (k.fx * local.x / local.z + k.cx, k.fy * local.y / local.z + k.cy);
        let ranges = &self.frame.ranges;
        if !(u >= 0.0 && v >= 0.0 && u < ranges.width as f64 && v < ranges.height as f64) {
            return None;
        }
        let range = local.length();
        let measured = f64::from(*ranges.at(u as usize, v as usize));
        let [constant, growing] = self.frame.tolerance.margin.map(f64::from);
        let margin = constant + growing * range;
        // Infinity (no surface) is a miss; NaN (unknown) is neither.
        let visibility = if measured > range + margin {
            Visibility::Miss
        } else if (measured - range).abs() <= margin {
            Visibility::Hit
        } else {
            return None; // hidden or unknown
        };
        // Normals that cancel out have no direction: no return is expected.
        let facing =
            (self.rotation * normal).dot(local).abs() / (range * normal.length().max(1e-30));
        Some((visibility, facing * self.h * self.h * k.fx * k.fy / (range * range)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::image::Image;
    use crate::math::pose::Pose;
    use crate::observation::surface::DepthTolerance;

    #[test]
    fn a_component_is_hit_within_the_margin_of_the_pixel_that_shows_it() {
        let intrinsics = Intrinsics { width: 4, height: 3, fx: 2.0, fy: 3.0, cx: 2.0, cy: 1.5 };
        let camera = Camera { intrinsics, pose: Pose::IDENTITY.with_origin(DVec3::NEG_X) };
        // Only the pixel in column 3, row 0 is known.
        let mut ranges = Image::filled(4, 3, f32::NAN);
        ranges.data[3] = 2.5;
        let tolerance = DepthTolerance { margin: [0.125, 0.0625], refinement: 0.0, place: 0.0 };
        let frame = Observation {
            origin: DVec3::Y,
            camera,
            points: Vec::new(),
            point_weight: 1,
            ranges,
            tolerance,
            photograph: None,
        };
        let viewer = FrameView::new(&frame, &camera, 0.5);
        // Through the pixel's middle, at a distance from the camera in (1, −1, 0).
        let ray = DVec3::new(0.75, -1.0 / 3.0, 1.0).normalize();
        let seen = |ray: DVec3, range: f64, normal: DVec3| {
            viewer.visibility(DVec3::new(1.0, -1.0, 0.0) + ray * range, normal)
        };
        // At 2 the margin is 0.25, at 2.6 it is 0.2875.
        for (range, expected) in [
            (2.0, Some(Visibility::Miss)),
            (2.3, Some(Visibility::Hit)),
            (2.7, Some(Visibility::Hit)),
            (2.9, None),
            (-2.0, None),
        ] {
            let found = seen(ray, range, DVec3::Z);
            assert_eq!(found.map(|(visibility, _)| visibility), expected, "{range}");
        }
        for (x, y) in [(0.2, -1.0 / 3.0), (0.75, 0.0), (1.1, -1.0 / 3.0), (0.75, -0.6)] {
            assert_eq!(seen(DVec3::new(x, y, 1.0), 2.0, DVec3::Z), None, "{x} {y}");
        }
        // Half a unit is 0.5 / 2.5 of the focal lengths in pixels; slanted surfaces return less.
        let returns = |normal| seen(ray, 2.5, normal).unwrap().1;
        assert!((returns(ray * -3.0) - 0.24).abs() < 1e-12);
        assert!((returns(DVec3::Z) - 0.24 * ray.z).abs() < 1e-12);
        assert_eq!(returns(DVec3::ZERO), 0.0);
    }
}
