//! Orbit camera: a camera on a sphere around a target, for mouse navigation and turntables.

use super::pose::Pose;
use glam::{DQuat, DVec3};
use std::f64::consts::FRAC_PI_2;

// Minimum distance of the elevation from the poles, radians: at a pole `up` has no image direction.
const POLE_MARGIN: f64 = 1e-3;

/// Camera position in spherical coordinates around a target.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::orbit::Orbit;
///
/// let (target, up) = (DVec3::ZERO, DVec3::Z);
/// let orbit = Orbit { target, up, azimuth: 0.3, elevation: 0.5, distance: 4.0 };
/// let pose = orbit.pose();
/// assert!((pose.centre().length() - 4.0).abs() < 1e-9);
/// assert!((Orbit::from_pose(&pose, up, 4.0).azimuth - 0.3).abs() < 1e-9);
/// ```
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// Point at the image centre, world units.
    pub target: DVec3,
    /// Direction that points up in the image; unit length.
    pub up: DVec3,
    /// Rotation about `up`, radians. If azimuth and elevation are 0 and `up` is z, the camera faces −x.
    /// For any other `up`, this view direction is rotated by the shortest arc from z to `up`.
    pub azimuth: f64,
    /// Angle above the horizon, radians.
    pub elevation: f64,
    /// Distance to the target, world units, positive.
    pub distance: f64,
}

impl Orbit {
    /// Builds the orbit of a camera whose target is `distance` world units in front of it.
    pub fn from_pose(pose: &Pose, up: DVec3, distance: f64) -> Self {
        let (right, ahead) = horizon(up);
        let back = -pose.forward();
        Self {
            target: pose.centre() + pose.forward() * distance,
            up,
            azimuth: back.dot(ahead).atan2(back.dot(right)),
            // Rounding may push the product past 1, where the arcsine is NaN.
            elevation: back.dot(up).clamp(-1.0, 1.0).asin(),
            distance,
        }
    }

    /// Returns the unit vector from the target to the camera.
    pub fn outward(&self) -> DVec3 {
        let (right, ahead) = horizon(self.up);
        // Clamped here and not on input: a drag over the pole and back returns to its start.
        let elevation = self.elevation.clamp(-FRAC_PI_2 + POLE_MARGIN, FRAC_PI_2 - POLE_MARGIN);
        let horizontal = right * self.azimuth.cos() + ahead * self.azimuth.sin();
        horizontal * elevation.cos() + self.up * elevation.sin()
    }

    /// Returns the camera's pose.
    pub fn pose(&self) -> Pose {
        let eye = self.target + self.outward() * self.distance;
        // The margin keeps the view direction off `up`, and the distance is positive, so this succeeds.
        Pose::look_at(eye, self.target, self.up).unwrap_or(Pose::IDENTITY)
    }
}

/// Returns two horizontal unit vectors that form a right-handed frame with `up`.
fn horizon(up: DVec3) -> (DVec3, DVec3) {
    let aligned = DQuat::from_rotation_arc(DVec3::Z, up);
    (aligned * DVec3::X, aligned * DVec3::Y)
}

// cos 30°: a mean up direction within this angle snaps to a coordinate axis.
const AXIS_COSINE: f64 = 0.866;

/// Returns the mean up direction of the cameras' images, in world axes; z if the directions nearly
/// cancel. A direction within 30° of a coordinate axis is replaced by that axis.
pub fn mean_up<'a>(poses: impl Iterator<Item = &'a Pose>) -> DVec3 {
    let (sum, n) =
        poses.fold((DVec3::ZERO, 0usize), |(sum, n), p| (sum - p.rotation().y_axis, n + 1));
    let mean = sum / n.max(1) as f64;
    // Cameras all around an object or held arbitrarily: their mean direction is meaningless.
    if mean.length() < 0.2 {
        return DVec3::Z;
    }
    let mean = mean.normalize();
    let axes = [DVec3::X, DVec3::Y, DVec3::Z, DVec3::NEG_X, DVec3::NEG_Y, DVec3::NEG_Z];
    axes.into_iter().find(|axis| axis.dot(mean) > AXIS_COSINE).unwrap_or(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pose_and_orbit_round_trip() {
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8)] {
            let orbit = Orbit {
                target: DVec3::new(1.0, 2.0, 3.0),
                up,
                azimuth: 0.7,
                elevation: 0.4,
                distance: 2.5,
            };
            let back = Orbit::from_pose(&orbit.pose(), up, 2.5);
            assert!((back.target - orbit.target).length() < 1e-12);
            assert!((back.azimuth - 0.7).abs() < 1e-12 && (back.elevation - 0.4).abs() < 1e-12);
        }
    }

    #[test]
    fn poles_are_survived() {
        for elevation in [9.0, -9.0] {
            let (target, up) = (DVec3::ZERO, DVec3::Z);
            let orbit = Orbit { target, up, azimuth: 0.0, elevation, distance: 1.0 };
            assert!(orbit.pose().forward().z * elevation < -8.99);
            // On the azimuth's side of the pole.
            assert!((orbit.outward().x - POLE_MARGIN).abs() < 1e-9);
        }
    }

    #[test]
    fn up_is_what_the_cameras_agree_on() {
        let circle: Vec<Pose> = (0..12)
            .map(|i| {
                let azimuth = i as f64 * std::f64::consts::FRAC_PI_6;
                Orbit { target: DVec3::ZERO, up: DVec3::Z, azimuth, elevation: 0.6, distance: 4.0 }
                    .pose()
            })
            .collect();
        assert_eq!(mean_up(circle.iter()), DVec3::Z);
        assert_eq!(mean_up([Pose::IDENTITY].iter()), DVec3::NEG_Y);
        assert_eq!(mean_up([].iter()), DVec3::Z);
        // Six with −y up and five upside down.
        let turned = Pose::look_at(DVec3::ZERO, DVec3::Z, DVec3::Y).unwrap();
        let nearly_cancelled = [Pose::IDENTITY, turned].into_iter().cycle().take(11);
        assert_eq!(mean_up(Vec::from_iter(nearly_cancelled).iter()), DVec3::Z);
    }
}
