//! Mapping from pixels to rays and back.

use super::options::Lens;
use crate::math::camera::Intrinsics;
use glam::{DVec2, DVec3};
use std::f64::consts::PI;

impl Lens {
    /// Ray in camera axes through a continuous image position in pixels, with `z = 1` for a pinhole and
    /// of unit length for a fisheye. `None` beyond the fisheye's field of view (`rendering.md`, Wide views
    /// and fisheye).
    pub fn ray(self, k: &Intrinsics, position: DVec2) -> Option<DVec3> {
        let offset = (position - DVec2::new(k.cx, k.cy)) / DVec2::new(k.fx, k.fy);
        match self {
            Self::Pinhole => Some(offset.extend(1.0)),
            Self::Fisheye => {
                let angle = offset.length();
                // sin(θ)/θ tends to 1 on the axis, where the division would give NaN.
                let sinc = if angle > 0.0 { angle.sin() / angle } else { 1.0 };
                (angle <= PI).then(|| (offset * sinc).extend(angle.cos()))
            }
        }
    }

    /// Continuous image position in pixels of a point in camera axes. `None` outside the field of
    /// view or if the position is not finite.
    pub fn project(self, k: &Intrinsics, point: DVec3) -> Option<DVec2> {
        let offset = match self {
            Self::Pinhole if point.z > 0.0 => point.truncate() / point.z,
            Self::Pinhole => return None,
            Self::Fisheye => {
                let across = point.truncate();
                let angle = across.length().atan2(point.z);
                across.try_normalize().map_or(DVec2::ZERO, |direction| direction * angle)
            }
        };
        let position = offset * DVec2::new(k.fx, k.fy) + DVec2::new(k.cx, k.cy);
        // Non-finite positions would be drawn as lines across the image.
        position.is_finite().then_some(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fisheye_pixel_is_an_angle() {
        let k = Intrinsics { width: 400, height: 300, fx: 100.0, fy: 100.0, cx: 0.5, cy: 100.5 };
        let ray = |column: f64| Lens::Fisheye.ray(&k, DVec2::new(column + 0.5, 100.5));
        assert_eq!(ray(0.0), Some(DVec3::Z));
        assert!((ray(157.0).unwrap() - DVec3::X).length() < 1e-3);
        assert!(ray(314.0).is_some() && ray(315.0).is_none());
    }

    #[test]
    fn points_along_a_ray_are_seen_where_it_starts() {
        let k = Intrinsics { width: 90, height: 60, fx: 25.0, fy: 27.0, cx: 44.0, cy: 31.0 };
        for lens in [Lens::Pinhole, Lens::Fisheye] {
            for position in [DVec2::new(44.0, 31.0), DVec2::new(3.5, 50.5), DVec2::new(80.0, 1.0)] {
                let ray = lens.ray(&k, position).unwrap();
                let seen = lens.project(&k, ray * 3.7).unwrap();
                assert!((seen - position).length() < 1e-9, "{lens} {position} {seen}");
            }
        }
        assert_eq!(Lens::Pinhole.project(&k, DVec3::new(1.0, 0.0, -1.0)), None);
        let behind = Lens::Fisheye.project(&k, DVec3::new(1e-3, 0.0, -1.0)).unwrap();
        assert!((behind.x - 44.0 - 25.0 * PI).abs() < 0.1);
        assert_eq!(Lens::Fisheye.ray(&k, DVec2::new(44.0 + 25.0 * 3.2, 31.0)), None);
    }
}
