//! What a calibration looks at: the frames, and what is known of their cameras so far.

use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::frame::Frame;
use crate::dataset::surface::SurfaceSettings;

/// Structural scale times the scene's at which the search begins: wrong depth parts surfaces.
pub(super) const COARSE: f64 = 4.0;

/// What is searched on.
pub(super) struct CalibrationInput {
    pub frames: Vec<Frame>,
    /// Whether the files measure depth along the optical axis.
    pub along_z: bool,
    /// How frames become points, but for the calibration.
    pub surface: SurfaceSettings,
    /// The corrections as far as they are found.
    pub calibration: Calibration,
    /// Structural scale, world units.
    pub h: f64,
    /// Every so-many-th pixel of every so-many-th row is looked at.
    pub step: usize,
}

impl CalibrationInput {
    /// The calibration's depth and exposure, with some colour camera.
    pub fn settings(&self, color_camera: Option<ColorCamera>) -> SurfaceSettings {
        let calibration = Some(Calibration { color_camera, ..self.calibration.clone() });
        SurfaceSettings { calibration, ..self.surface.clone() }
    }
}
