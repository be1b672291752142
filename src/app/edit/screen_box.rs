//! Selects splats by a rectangle on the screen.

use crate::math::camera::Camera;
use crate::model::splat::splats::Splat;
use crate::render::Lens;
use glam::{DVec2, DVec3};

/// Slots of drawable splats whose centres project between corners `a` and `b` (pixels), including occluded
/// splats. `near` is the near plane, world units.
pub fn slots_within<'a>(
    splats: &'a [Splat],
    camera: &'a Camera,
    lens: Lens,
    near: f64,
    [a, b]: [DVec2; 2],
) -> impl Iterator<Item = u32> + 'a {
    let (low, high) = (a.min(b), a.max(b));
    let (rotation, translation) = camera.pose.inverse();
    let is_within = move |splat: &Splat| {
        let point = rotation * DVec3::from_array(splat.mean.map(f64::from)) + translation;
        let ahead = match lens {
            Lens::Pinhole => point.z,
            Lens::Fisheye => point.length(),
        };
        splat.is_drawable()
            && ahead > near
            && lens
                .project(&camera.intrinsics, point)
                .is_some_and(|at| at.cmpge(low).all() && at.cmple(high).all())
    };
    splats.iter().zip(0..).filter(move |(splat, _)| is_within(splat)).map(|(_, slot)| slot)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;

    #[test]
    fn centres_ahead_of_the_camera_are_found_however_deep() {
        let camera = Camera {
            intrinsics: Intrinsics::from_horizontal_fov(100, 100, 1.0),
            pose: Pose::IDENTITY,
        };
        let at = |x: f32, z: f32| Splat {
            mean: [x, 0.0, z],
            opacity: 1.0,
            scale: [0.1; 3],
            rotation: [1.0, 0.0, 0.0, 0.0],
            ..Splat::default()
        };
        let mut splats =
            vec![at(0.0, 1.0), at(0.0, 9.0), at(0.0, -1.0), at(0.5, 1.0), at(0.0, 2.0)];
        splats[4].opacity = 0.0;
        // Corners in any order are accepted.
        let corners = [DVec2::new(60.0, 40.0), DVec2::new(40.0, 60.0)];
        let found: Vec<u32> = slots_within(&splats, &camera, Lens::Pinhole, 0.1, corners).collect();
        assert_eq!(found, [0, 1]);
    }
}
