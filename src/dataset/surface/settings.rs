//! Settings of the surface stage.

use super::sensor::{Profile, Sensor, Thresholds};
use crate::dataset::calibration::Calibration;
use crate::dataset::depth::Depth;
use crate::dataset::opened::Dataset;
use crate::math::camera::Intrinsics;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::ops::RangeInclusive;
use strum::{Display, EnumString, VariantNames};

/// Settings of the conversion of frames to observations; each stage can be disabled.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct SurfaceSettings {
    /// Sensor of the depth: its noise and thresholds.
    pub sensor: Sensor,
    /// Thresholds that override the sensor's.
    pub thresholds: Option<Thresholds>,
    /// Replaces measured depth by the depth of the plane fitted around the pixel. Normals are those of
    /// the plane in any case.
    pub plane_fit: bool,
    /// Drops pixels without an accepted plane. Otherwise such pixels keep their measured depth, and
    /// their normals point to the camera.
    pub flying_pixels: bool,
    /// Drops pixels on surfaces seen at a slant.
    pub cosine: bool,
    /// Drops slanted surfaces that a Kinect's coarse pixels cannot tell from edges. Calibration sets this
    /// value, since their error within a pixel would bias it; files do not contain it.
    #[serde(skip)]
    pub omits_slants: bool,
    /// Selection of the pixels that become points.
    // The default is not written, so that files of such scenes stay unchanged.
    #[serde(default, skip_serializing_if = "PixelSampling::is_every")]
    pub sampling: PixelSampling,
    /// Corrections of cameras and depth; `None` is [`Calibration::NONE`].
    pub calibration: Option<Calibration>,
    /// World position to which points are relative.
    #[serde(serialize_with = "to_array", deserialize_with = "from_array")]
    pub origin: DVec3,
    /// Adds the photograph to observations. The trainer sets this value; files do not contain it.
    #[serde(skip)]
    pub photograph: bool,
}

impl SurfaceSettings {
    /// Creates settings with every stage enabled, for the dataset's sensor and its known calibration.
    pub fn new(dataset: &Dataset, origin: DVec3) -> Self {
        let calibration = dataset.known_calibration();
        Self { calibration, ..Self::of_sensor(dataset.sensor(), origin) }
    }

    /// Creates settings with every stage enabled, for frames whose colour is registered to depth, such
    /// as frames from memory.
    pub fn of_sensor(sensor: Sensor, origin: DVec3) -> Self {
        Self {
            sensor,
            thresholds: None,
            plane_fit: true,
            flying_pixels: true,
            cosine: true,
            omits_slants: false,
            sampling: PixelSampling::Every,
            calibration: None,
            origin,
            photograph: false,
        }
    }

    pub(super) fn calibration(&self) -> &Calibration {
        static NONE: Calibration = Calibration::NONE;
        self.calibration.as_ref().unwrap_or(&NONE)
    }

    pub(super) fn profile(&self, depth: &Depth, camera: &Intrinsics) -> Profile {
        let mut profile = self.sensor.profile(depth, camera);
        profile.thresholds = self.thresholds.unwrap_or(profile.thresholds);
        if self.omits_slants && self.sensor == Sensor::Kinect {
            profile.steepness = 0.0;
        }
        profile
    }
}

fn to_array<S: serde::Serializer>(v: &DVec3, serializer: S) -> Result<S::Ok, S::Error> {
    v.to_array().serialize(serializer)
}

fn from_array<'de, D: serde::Deserializer<'de>>(from: D) -> Result<DVec3, D::Error> {
    <[f64; 3]>::deserialize(from).map(DVec3::from_array)
}

/// Number of pixels from the centre of the fit's window to its border.
pub(super) const RADIUS: usize = 2;
/// Maximum number of least-squares rounds. From the second round on, only inliers are fitted.
pub(super) const ROUNDS: usize = 3;
/// Minimum number of inliers in each round, including the pixel itself.
pub(super) const MIN_INLIERS: usize = 5;
/// Minimum share of inliers in the window after the last round.
pub(super) const MIN_SHARE: f64 = 0.3;
pub(super) const TILE: usize = 8;
/// Range of lengths whose squares and inverses are representable in f32.
pub(super) const LENGTHS: RangeInclusive<f64> = 1e-9..=1e9;

/// Selection of the pixels that become points. Each point is weighted by the number of pixels it
/// represents. Neighbouring plane fits over 5×5 pixels are redundant, and later frames show skipped
/// places again.
#[derive(
    Clone,
    Copy,
    Debug,
    Default,
    PartialEq,
    Eq,
    Serialize,
    Deserialize,
    Display,
    EnumString,
    VariantNames,
)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum PixelSampling {
    /// Every pixel becomes a point.
    #[default]
    Every,
    /// Every other pixel of every other row becomes a point.
    Quarter,
}

impl PixelSampling {
    /// True if every usable pixel becomes a point.
    pub fn is_every(&self) -> bool {
        *self == Self::Every
    }

    /// Returns the number of pixels represented by a point.
    pub fn weight(self) -> u32 {
        match self {
            Self::Every => 1,
            Self::Quarter => 4,
        }
    }

    /// Returns the distance between used rows and between used columns, pixels.
    pub(super) fn step(self) -> usize {
        if self.is_every() { 1 } else { 2 }
    }
}
