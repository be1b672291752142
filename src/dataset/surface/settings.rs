//! What to make of a frame.

use super::sampling::PixelSampling;
use super::sensor::{Profile, Sensor, Thresholds};
use crate::dataset::calibration::Calibration;
use crate::dataset::depth::Depth;
use crate::dataset::opened::Dataset;
use crate::math::camera::Intrinsics;
use glam::DVec3;
use serde::{Deserialize, Serialize};

/// How frames become observations; each stage can be left out.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceSettings {
    /// What the depth is from: its noise and thresholds.
    pub sensor: Sensor,
    /// Thresholds in place of the sensor's.
    pub thresholds: Option<Thresholds>,
    /// Depth is that of the plane fitted around the pixel; otherwise as measured. The normal is
    /// the plane's in any case.
    pub plane_fit: bool,
    /// Pixels that no plane explains are dropped; otherwise they keep their measured depth and face
    /// the camera.
    pub flying_pixels: bool,
    /// Surfaces seen at a slant are dropped.
    pub cosine: bool,
    /// Which pixels become points.
    // Left out where all do, so that files of such scenes are what they were.
    #[serde(default, skip_serializing_if = "PixelSampling::is_every")]
    pub sampling: PixelSampling,
    /// Corrections of the cameras; `None` is [`Calibration::NONE`].
    pub calibration: Option<Calibration>,
    /// World position that points are relative to.
    #[serde(serialize_with = "to_array", deserialize_with = "from_array")]
    pub origin: DVec3,
    /// Whether observations carry the photograph. What learns decides, not a file.
    #[serde(skip)]
    pub photograph: bool,
}

impl SurfaceSettings {
    /// Every stage, with the sensor of the dataset and what is known of its cameras.
    pub fn new(dataset: &Dataset, origin: DVec3) -> Self {
        let calibration = dataset.known_calibration();
        Self { calibration, ..Self::of_sensor(dataset.sensor(), origin) }
    }

    /// Every stage, for frames of a sensor whose colour is registered to depth: what a program that
    /// hands over its frames from memory begins with.
    pub fn of_sensor(sensor: Sensor, origin: DVec3) -> Self {
        Self {
            sensor,
            thresholds: None,
            plane_fit: true,
            flying_pixels: true,
            cosine: true,
            sampling: PixelSampling::Every,
            calibration: None,
            origin,
            photograph: false,
        }
    }

    /// The corrections to apply.
    pub(super) fn calibration(&self) -> &Calibration {
        static NONE: Calibration = Calibration::NONE;
        self.calibration.as_ref().unwrap_or(&NONE)
    }

    /// The sensor's profile with these thresholds.
    pub(super) fn profile(&self, depth: &Depth, camera: &Intrinsics) -> Profile {
        let mut profile = self.sensor.profile(depth, camera);
        profile.thresholds = self.thresholds.unwrap_or(profile.thresholds);
        profile
    }
}

fn to_array<S: serde::Serializer>(v: &DVec3, serializer: S) -> Result<S::Ok, S::Error> {
    v.to_array().serialize(serializer)
}

fn from_array<'de, D: serde::Deserializer<'de>>(from: D) -> Result<DVec3, D::Error> {
    <[f64; 3]>::deserialize(from).map(DVec3::from_array)
}
