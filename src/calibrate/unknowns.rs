//! The vector of all unknowns and its prior.
//!
//! Depth scale, depth offset, focal length and camera offset are correlated. They are fitted jointly,
//! so that their covariance includes the correlation. A sensor prior excludes implausible values: a
//! depth scale of 1.18 explains some recordings best, but no depth camera has such an error.

use super::camera::{CameraUnknowns, FOCAL, N as N_CAMERA, ROLL};
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::math::least_squares::NormalEquations;
use glam::DVec3;
use serde::Serialize;

/// Number of unknowns: those of depth, followed by those of the colour camera.
pub(super) const N: usize = 2 + N_CAMERA;
/// Number of unknowns including the pose of one view: translation and rotation of its camera, in the
/// camera's frame.
pub(super) const WITH_POSE: usize = N + 6;
pub(super) const DEPTH: [usize; 2] = [0, 1];
pub(super) const CAMERA: usize = 2;
pub(super) const NAMES: [&str; N] = [
    "depth offset, world units",
    "depth scale",
    "colour camera offset x, world units",
    "colour camera offset y, world units",
    "colour camera roll, radians",
    "colour focal length, pixels",
    "colour principal point x, pixels",
    "colour principal point y, pixels",
];

/// Prior standard deviation of the depth offset of consumer sensors, metres. The next constants are
/// those of the depth scale and the colour camera (metres, radians).
const DEPTH_OFFSET_M: f64 = 0.015;
const DEPTH_SCALE: f64 = 0.02;
const CAMERA_OFFSET_M: f64 = 0.03;
const CAMERA_ROLL: f64 = 0.02;
const LOG_FOCAL: f64 = 0.08;
/// Prior standard deviation of the principal point, relative to the image width.
const PRINCIPAL: f64 = 0.03;

/// Prior standard deviation of recorded positions, metres; the next constant is that of orientations,
/// radians. Measured errors of recordings are 2 to 18 mm and 0.012 radians.
const POSE_SHIFT_M: f64 = 0.005;
const POSE_TURN: f64 = 0.005;

#[derive(Clone, Copy, Debug)]
pub(super) struct Unknowns {
    /// Depth offset (world units) and depth scale.
    pub depth: [f64; 2],
    pub camera: CameraUnknowns,
}

impl Unknowns {
    pub fn of(calibration: &Calibration, camera: ColorCamera) -> Self {
        let depth = [calibration.depth_offset, calibration.depth_scale];
        Self { depth, camera: CameraUnknowns::of(camera) }
    }

    pub fn get(&self, i: usize) -> f64 {
        if i < CAMERA { self.depth[i] } else { self.camera.values[i - CAMERA] }
    }

    pub fn set(&mut self, i: usize, value: f64) {
        if i < CAMERA {
            self.depth[i] = value;
        } else {
            self.camera.values[i - CAMERA] = value;
        }
    }

    /// Returns an unknown in its natural parameters. The focal length is in pixels instead of a
    /// logarithm. Roll (radians) is absolute instead of relative to the initial camera.
    pub fn natural_value(&self, i: usize) -> f64 {
        match i.checked_sub(CAMERA) {
            Some(FOCAL) => self.camera.camera().focal[0],
            Some(ROLL) => self.camera.camera().rotation[2],
            _ => self.get(i),
        }
    }

    pub fn natural_slope(&self, i: usize) -> f64 {
        // The unknown is the logarithm of the focal length factor.
        if i == CAMERA + FOCAL { self.natural_value(i) } else { 1.0 }
    }
}

/// Pose correction of a view: translation (world units) and rotation (radians) of its camera. It is
/// relative to the recorded pose, in the camera's frame.
pub(super) type Twist = [f64; 6];

pub(super) fn split_twist(twist: &Twist) -> [DVec3; 2] {
    let [x, y, z, turns @ ..] = *twist;
    [DVec3::new(x, y, z), DVec3::from_array(turns)]
}

#[derive(Clone, Debug)]
pub(super) struct Estimate {
    pub unknowns: Unknowns,
    pub poses: Vec<Twist>,
}

impl Estimate {
    pub fn as_recorded(unknowns: Unknowns, n_views: usize) -> Self {
        Self { unknowns, poses: vec![[0.0; 6]; n_views] }
    }
}

#[derive(Clone, Debug)]
pub(super) struct SensorPrior {
    mean: [f64; N],
    deviation: [f64; N],
    /// Standard deviations of a pose's translation (world units) and rotation (radians).
    pose: [f64; 2],
}

impl SensorPrior {
    /// Creates a prior centred on uncorrected depth and on `known`, the layout's known colour camera.
    /// `metre` is the length of a metre in world units. Camera unknowns are relative to `start`.
    pub fn new(known: ColorCamera, start: &Unknowns, metre: f64) -> Self {
        let camera = start.camera.parameters_of(&known);
        // The image width is unknown here, and the principal point is near its middle.
        let width = 2.0 * known.principal[0].max(1.0);
        // Depth as decoded: offset 0 and scale 1.
        let mut mean = [0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
        mean[CAMERA..].copy_from_slice(&camera);
        let across = CAMERA_OFFSET_M * metre;
        let principal = PRINCIPAL * width;
        let deviation = [
            DEPTH_OFFSET_M * metre,
            DEPTH_SCALE,
            across,
            across,
            CAMERA_ROLL,
            LOG_FOCAL,
            principal,
            principal,
        ];
        let pose = [POSE_SHIFT_M * metre, POSE_TURN];
        Self { mean, deviation, pose }
    }

    pub fn add_pose(&self, pose: &Twist, equations: &mut NormalEquations<WITH_POSE>) {
        for (i, value) in pose.iter().enumerate() {
            // Three translations, then three rotations.
            equations.add_prior(N + i, *value, self.pose[i / 3]);
        }
    }

    pub fn equations(&self, at: &Unknowns) -> NormalEquations<N> {
        let mut equations = NormalEquations::ZERO;
        for i in 0..N {
            equations.add_prior(i, at.get(i) - self.mean[i], self.deviation[i]);
        }
        equations
    }
}

/// Estimated value before and after the calibration, and whether the data determines it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CalibratedValue {
    /// Name of the value, with its unit.
    pub name: &'static str,
    /// Initial value.
    pub before: f64,
    /// Value in the resulting calibration: the initial one, unless the data determines this value or
    /// correlated ones.
    pub after: f64,
    /// Value that explains the data best.
    pub best: f64,
    /// Standard error of `best`, from the scatter of the views and the sensor prior. Errors common to all
    /// views, e.g. of a map to which the poses were fitted, are not included.
    pub standard_error: f64,
    /// True if the data determines the value.
    pub determined: bool,
    /// Reason why the value was not changed, or was changed only because other values depend on it.
    pub reason: Option<String>,
}

impl CalibratedValue {
    pub(super) fn determined(name: &'static str, before: f64, best: f64, error: f64) -> Self {
        let (after, standard_error) = (best, error);
        Self { name, before, after, best, standard_error, determined: true, reason: None }
    }

    pub(super) fn revert(&mut self, reason: String) {
        // `best` is retained, so that the report shows what was rejected and why.
        self.after = self.before;
        self.determined = false;
        self.reason = Some(reason);
    }

    /// Accepts the best value although it is not determined by itself, because other values depend on it.
    pub(super) fn accept_as_correlated(&mut self, reason: String) {
        self.determined = false;
        self.reason = Some(format!("{reason}; taken with the others, which depend on it"));
    }

    /// Keeps the initial value because the data confirms it.
    pub(super) fn confirm_initial(&mut self, reason: String) {
        self.revert(reason);
        self.determined = true;
    }
}
