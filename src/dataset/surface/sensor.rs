//! Noise of depth by kind of sensor, and the resulting thresholds of the plane fit.
//!
//! Every threshold of the fit is in units of the noise half-width. So a noise law and a few further
//! numbers describe a sensor. The 8-bit ray depth and the Kinect were measured (`dataset.md`, Sensors).
//! The other noise laws follow from published accuracy or from the computation of depth; the
//! thresholds, in units of the noise, are the Kinect's. The layout determines the sensor; the images do
//! not show it.

use crate::dataset::depth::{Depth, DepthCodes, DepthKind, INVERSE8_RANGE, SENSOR_NOISE};
use crate::math::camera::Intrinsics;
use crate::observation::surface::DepthTolerance;
use serde::{Deserialize, Serialize};

/// Length of one step of 8-bit ray depth, world units.
const INVERSE8_LEVEL: f64 = INVERSE8_RANGE / 255.0;
/// Standard deviations per noise half-width; covers nearly all values of a normal distribution. With 2,
/// the fit would needlessly drop 5 % of the pixels of the synthetic room.
const DEVIATIONS: f64 = 3.0;
/// Depth step, in pixel widths, between neighbouring pixels on the steepest surface that low-noise
/// sensors can measure. It is the tangent of the angle whose cosine is 0.4.
const STEEPEST: f64 = 2.3;
/// Pixel widths per unit of z up to which a Kinect's noise covers the slant of surfaces: a focal length of
/// 260 pixels, as at 320 columns. Coarser pixels allow [`STEEPEST`] for what is beyond.
const FINE_PIXEL: f64 = 1.0 / 260.0;
/// Noise half-width of exact depth, in pixel widths. It allows for curved surfaces and edges, which
/// deviate from a plane within the window of the fit. For other sensors, it is 2 to 4. In the synthetic
/// room, 0.25 would drop 12 % of the pixels, all at edges; 1 drops 3 %.
const CURVATURE: f64 = 1.0;

/// Kind of depth sensor. It determines the noise law and the thresholds of the plane fit.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize, strum::EnumString)]
#[serde(rename_all = "kebab-case")]
#[strum(serialize_all = "kebab-case")]
pub enum Sensor {
    /// 8-bit depth along the ray in NeRF-synthetic (`dataset.md`, Sensors). The error is the
    /// quantisation of one code and a bias of an eighth of a code.
    Inverse8Ray,
    /// Structured light, with depth in metres (`dataset.md`, Sensors).
    Kinect,
    /// Time of flight in phones and tablets, with depth in metres. It is accurate to a centimetre on
    /// large surfaces (Luetzenburg, Kroon and Bjørk 2021, doi 10.1038/s41598-021-01763-9). The error
    /// grows with distance. On slanted surfaces of its coarse images, depth steps between pixels exceed
    /// the noise.
    Lidar,
    /// Exact depth computed by a renderer, in fine steps.
    Exact {
        /// Standard deviation of added noise, in the unit of
        /// [`crate::dataset::synthetic::SyntheticParams::depth_noise`].
        noise: f64,
    },
}

/// Half-width of the noise of depth `z`. It is the maximum of four terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseLaw {
    /// Constant term along the ray, world units. It is divided by the length of the ray per unit of z.
    pub ray: f64,
    /// Constant term along the optical axis, world units.
    pub floor: f64,
    /// Coefficient of z: noise proportional to distance.
    pub linear: f64,
    /// Coefficient of z², per world unit: noise of triangulation.
    pub quadratic: f64,
}

/// Thresholds of the plane fit (`dataset.md`, Sensors). All except the cosine are in units of the noise
/// half-width.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Thresholds {
    /// Largest residual of an inlier.
    pub inlier: f64,
    /// Largest root mean square residual of the inliers.
    pub residual: f64,
    /// Largest distance between the measured and the fitted depth.
    pub deviation: f64,
    /// Smallest cosine between a surface's normal and the direction to the camera.
    pub cosine: f64,
}

/// Properties of a sensor for one depth image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Half-width of the noise.
    pub noise: NoiseLaw,
    /// Offset added to every decoded length, world units.
    pub offset: f64,
    /// Allowed depth step between neighbouring pixels in addition to noise, relative to z.
    pub steepness: f64,
    /// Thresholds of the plane fit.
    pub thresholds: Thresholds,
    /// Tolerance between measured and modelled depth (`dataset.md`, Sensors).
    pub tolerance: DepthTolerance,
}

impl NoiseLaw {
    const ZERO: Self = Self { ray: 0.0, floor: 0.0, linear: 0.0, quadratic: 0.0 };

    /// Returns the half-width of the noise at depth `z`, on a ray of length `per_z` per unit of z.
    #[inline]
    pub fn at(&self, z: f64, per_z: f64) -> f64 {
        (self.ray / per_z).max(self.floor).max(self.linear * z).max(self.quadratic * z * z)
    }
}

/// Thresholds measured with the Kinect.
const METRIC_THRESHOLDS: Thresholds =
    Thresholds { inlier: 1.0, residual: 0.6, deviation: 1.0, cosine: 0.3 };
/// Tolerance measured with the Kinect, metres.
const METRIC_TOLERANCE: DepthTolerance =
    DepthTolerance { margin: [0.03, 0.02], refinement: 0.03, place: 0.03 };
/// Standard deviation of camera positions tracked by a phone with lidar, metres (`scene.md`, Pose
/// alignment).
const PHONE_PLACE: f32 = 0.002;

impl Sensor {
    /// Returns the sensor's profile for a depth image of a camera. Values known in metres are converted
    /// to world units.
    pub fn profile(self, depth: &Depth, camera: &Intrinsics) -> Profile {
        let metric = |mut profile: Profile| {
            let metre = depth.units_per_metre;
            // `linear` and the second margin are ratios, and metric sensors have no constant along the ray.
            profile.noise.floor *= metre;
            profile.noise.quadratic /= metre;
            profile.tolerance.margin[0] *= metre as f32;
            profile.tolerance.refinement *= metre as f32;
            profile.tolerance.place *= metre as f32;
            profile
        };
        match self {
            Self::Inverse8Ray => Profile {
                noise: NoiseLaw { ray: INVERSE8_LEVEL, ..NoiseLaw::ZERO },
                // The bias matters: a quarter of a code the other way costs 1.7 dB on Lego.
                offset: 0.004,
                steepness: 0.0,
                thresholds: Thresholds { inlier: 0.6, residual: 0.5, deviation: 0.6, cosine: 0.4 },
                // The margin is 1.6 codes, refinement half a code.
                tolerance: DepthTolerance { margin: [0.05, 0.0], refinement: 0.016, place: 0.016 },
            },
            Self::Kinect => metric(Profile {
                noise: NoiseLaw { floor: SENSOR_NOISE, quadratic: SENSOR_NOISE, ..NoiseLaw::ZERO },
                offset: 0.0,
                steepness: STEEPEST * (1.0 / camera.fx - FINE_PIXEL).max(0.0),
                thresholds: METRIC_THRESHOLDS,
                tolerance: METRIC_TOLERANCE,
            }),
            Self::Lidar => metric(Profile {
                noise: NoiseLaw { floor: 0.01, linear: 0.005, ..NoiseLaw::ZERO },
                offset: 0.0,
                steepness: STEEPEST / camera.fx,
                thresholds: METRIC_THRESHOLDS,
                tolerance: DepthTolerance { place: PHONE_PLACE, ..METRIC_TOLERANCE },
            }),
            Self::Exact { noise } => exact(noise, depth, camera),
        }
    }
}

/// Returns the profile of exact depth: rounding of a code, added noise, and the curvature of surfaces.
/// Margins are the Kinect's in units of its noise, plus the depth span of a slanted surface within a
/// pixel.
fn exact(noise: f64, depth: &Depth, camera: &Intrinsics) -> Profile {
    let unit = match depth.codes {
        DepthCodes::Inverse8(_) => INVERSE8_LEVEL,
        DepthCodes::Linear16 { unit, .. } => unit,
        DepthCodes::Lengths(_) => 0.0,
    };
    // A code rounds along the direction in which depth is measured.
    let along = |kind: DepthKind| if depth.kind == kind { unit } else { 0.0 };
    // Generated noise is given in units of the half-width at 1 m.
    let noisy = DEVIATIONS * noise * SENSOR_NOISE * depth.units_per_metre;
    let margin =
        [2.0 * unit + 10.0 * noisy, STEEPEST / camera.fx + 6.0 * noisy / depth.units_per_metre];
    Profile {
        noise: NoiseLaw {
            ray: along(DepthKind::RayDistance),
            floor: along(DepthKind::Z).max(noisy),
            linear: CURVATURE / camera.fx,
            quadratic: noisy / depth.units_per_metre.powi(2),
        },
        offset: 0.0,
        steepness: STEEPEST / camera.fx,
        thresholds: METRIC_THRESHOLDS,
        tolerance: DepthTolerance {
            margin: margin.map(|m| m as f32),
            refinement: (2.0 * unit + 10.0 * noisy) as f32,
            place: (2.0 * unit + 10.0 * noisy) as f32,
        },
    }
}
