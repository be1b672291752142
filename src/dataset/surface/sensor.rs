//! How wrong depth is, by kind of sensor, and what follows for the plane fit.
//!
//! Every threshold of the fit is in units of the noise half-width, so that a sensor is told by
//! its noise law and few numbers beside it. The two sensors of the recipe were measured
//! (`dataset.md`, Sensors); the others follow from published accuracy or from how depth was
//! computed, with the Kinect's thresholds in those units. Which sensor a dataset is of, its
//! layout states: nothing in the images tells.

use crate::dataset::depth::{Depth, DepthCodes, DepthKind, INVERSE8_RANGE, SENSOR_NOISE};
use crate::math::camera::Intrinsics;
use crate::observation::surface::DepthTolerance;
use serde::{Deserialize, Serialize};

/// Length of one code of 8-bit ray depth.
const INVERSE8_LEVEL: f64 = INVERSE8_RANGE / 255.0;
/// Standard deviations in a noise half-width: nearly all of a normal law's values. With 2, 5 % of the
/// pixels of the synthetic room would be dropped for nothing.
const DEVIATIONS: f64 = 3.0;
/// Depth step between neighbouring pixels of the steepest surface that sensors of little noise
/// look at, in pixel widths: the tangent of the angle whose cosine is .4.
const STEEPEST: f64 = 2.3;
/// Noise half-width of exact depth, in pixel widths: how far a curved or edged surface may leave its
/// plane within the window of the fit. The other sensors have 2 to 4. Of the synthetic room .25 would
/// drop 12 % of the pixels, all at edges; 1 drops 3 %.
const CURVATURE: f64 = 1.0;

/// A kind of depth sensor: its noise law and the thresholds that were measured with it.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sensor {
    /// NeRF-synthetic's 8-bit depth along the ray (`dataset.md`, Sensors): quantisation of one
    /// code, and a bias of an eighth of it.
    Inverse8Ray,
    /// Structured light, metres (`dataset.md`, Sensors).
    Kinect,
    /// Time of flight in phones and tablets, metres: good to a centimetre on large surfaces
    /// (Luetzenburg, Kroon and Bjørk 2021, doi 10.1038/s41598-021-01763-9), growing with distance;
    /// coarse images, whose slanted surfaces step more from pixel to pixel than noise does.
    Lidar,
    /// Computed depth in fine steps.
    Exact {
        /// Noise that was added, as [`crate::dataset::synthetic::SyntheticParams::depth_noise`].
        noise: f64,
    },
}

/// Half-width of the depth noise in units of z: the largest of its terms.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NoiseLaw {
    /// Along the ray whatever the distance: divided by the length of the ray per unit of z.
    pub ray: f64,
    /// A constant whatever the distance, world units.
    pub floor: f64,
    /// Multiplied by z: noise that grows with distance.
    pub linear: f64,
    /// Multiplied by z², per world unit: triangulation.
    pub quadratic: f64,
}

/// Thresholds of the plane fit, all but the cosine in units of the noise half-width
/// (`dataset.md`, Sensors).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Thresholds {
    /// Largest residual of a neighbour that takes part.
    pub inlier: f64,
    /// Largest root mean square residual of those.
    pub residual: f64,
    /// Largest distance between the measured and the fitted depth.
    pub deviation: f64,
    /// Smallest cosine between a surface's normal and the direction to the camera.
    pub cosine: f64,
}

/// All that a sensor says of one depth image.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Profile {
    /// Half-width of the noise.
    pub noise: NoiseLaw,
    /// Added to every length as decoded.
    pub offset: f64,
    /// Depth step from pixel to pixel that a neighbour may show beside noise, times z.
    pub steepness: f64,
    /// Thresholds of the plane fit.
    pub thresholds: Thresholds,
    /// How far measured and modelled depth may differ (`dataset.md`, Sensors).
    pub tolerance: DepthTolerance,
}

impl Profile {
    /// Where a metre is so many world units and not one.
    fn with_metre(mut self, metre: f64) -> Self {
        let length = metre as f32;
        self.noise.floor *= metre;
        self.noise.quadratic /= metre;
        self.tolerance.margin[0] *= length;
        self.tolerance.refinement *= length;
        self.tolerance.place *= length;
        self
    }
}

impl NoiseLaw {
    const ZERO: Self = Self { ray: 0.0, floor: 0.0, linear: 0.0, quadratic: 0.0 };

    /// At depth `z`, on a ray of length `per_z` per unit of z.
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
/// Standard deviation of the places that a phone with lidar tracks, metres (`scene.md`, Pose alignment).
const PHONE_PLACE: f32 = 0.002;

impl Sensor {
    /// What it says of a depth image seen through a camera; what is known in metres, in the unit of
    /// the image's world.
    pub fn profile(self, depth: &Depth, camera: &Intrinsics) -> Profile {
        let metric = |profile: Profile| profile.with_metre(depth.metre);
        match self {
            Self::Inverse8Ray => Profile {
                noise: NoiseLaw { ray: INVERSE8_LEVEL, ..NoiseLaw::ZERO },
                // A wrong bias is dear: a quarter of a code the other way costs 1.7 dB on Lego.
                offset: 0.004,
                steepness: 0.0,
                thresholds: Thresholds { inlier: 0.6, residual: 0.5, deviation: 0.6, cosine: 0.4 },
                // The margin is 1.6 codes, refinement reaches half a one.
                tolerance: DepthTolerance { margin: [0.05, 0.0], refinement: 0.016, place: 0.016 },
            },
            Self::Kinect => metric(Profile {
                noise: NoiseLaw { floor: SENSOR_NOISE, quadratic: SENSOR_NOISE, ..NoiseLaw::ZERO },
                offset: 0.0,
                steepness: 0.0,
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

/// Computed depth: what a code rounds off, the noise that was added, and the surface's own
/// curvature. Margins are those of the Kinect in units of its noise, plus what a slanted surface
/// spans within a pixel.
fn exact(noise: f64, depth: &Depth, camera: &Intrinsics) -> Profile {
    let unit = match depth.codes {
        DepthCodes::Inverse8(_) => INVERSE8_LEVEL,
        DepthCodes::Linear16 { unit, .. } => unit,
        DepthCodes::Lengths(_) => 0.0,
    };
    let along = |kind: DepthKind| if depth.kind == kind { unit } else { 0.0 };
    // Generated noise is given in units of the half-width at 1 m.
    let noisy = DEVIATIONS * noise * SENSOR_NOISE * depth.metre;
    let margin = [2.0 * unit + 10.0 * noisy, STEEPEST / camera.fx + 6.0 * noisy / depth.metre];
    Profile {
        noise: NoiseLaw {
            ray: along(DepthKind::RayDistance),
            floor: along(DepthKind::Z).max(noisy),
            linear: CURVATURE / camera.fx,
            quadratic: noisy / depth.metre.powi(2),
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
