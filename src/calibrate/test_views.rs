//! Synthetic views for calibration tests.

use super::matches::{CameraPose, MatchedDepth, Matches};
use super::pyramid::Pyramid;
use super::unknowns::{SensorPrior, Unknowns};
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::math::image::Image;
use crate::observation::surface::SurfacePoint;
use glam::{DMat3, DVec3};

pub(super) const CAMERA: ColorCamera = ColorCamera {
    focal: [80.0, 80.0],
    principal: [40.0, 30.0],
    offset: [0.01, -0.02, 0.0],
    rotation: [0.0, 0.0, 0.02],
    size: None,
};

pub(super) fn begin() -> Unknowns {
    Unknowns::of(&Calibration::NONE, CAMERA)
}

pub(super) fn prior() -> SensorPrior {
    SensorPrior::new(CAMERA, &begin(), 1.0)
}

pub(super) fn stand(centre: DVec3) -> CameraPose {
    CameraPose { rotation: DMat3::IDENTITY, centre }
}

pub(super) const MEASURED: MatchedDepth = MatchedDepth { values: [0.0, 1.0], along_z: false };

pub(super) fn ramps(n: usize) -> Vec<Pyramid> {
    let ramp = |i: usize| [(3 * (i % 80)) as u8, (4 * (i / 80)) as u8, 100, 255];
    let image = || Image::from_vec(80, 60, (0..80 * 60).map(ramp).collect());
    (0..n).map(|_| Pyramid::new(image(), 1)).collect()
}

/// Returns matches of a wall seen by two cameras. The second camera is closer by `nearer` (world units).
pub(super) fn wall(nearer: f64) -> Matches {
    let (mut views, mut poses) = (Vec::new(), Vec::new());
    for view in 0..2 {
        let centre = DVec3::new(0.1 * f64::from(view), 0.0, nearer * f64::from(view));
        let point = |i: u32| {
            let place = DVec3::new(
                0.03 * f64::from(i % 16) - 0.2,
                0.03 * f64::from(i / 16) - 0.2,
                2.0 + 0.01 * f64::from(view),
            );
            SurfacePoint {
                position: place.as_vec3().to_array(),
                direction: (place - centre).normalize().as_vec3().to_array(),
                normal: [0.0, 0.0, -1.0],
                noise: 0.003,
                ..SurfacePoint::default()
            }
        };
        views.push((0..256).map(point).collect());
        poses.push(stand(centre));
    }
    Matches::from_views(&views, poses, MEASURED, 0.1)
}
