//! What a calibration looks at: the frames, and what is known of their cameras so far.

use super::matches::{MatchedDepth, Matches};
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{PixelSampling, SurfaceSettings};

/// What is searched on.
pub(super) struct CalibrationInput {
    /// Every other one first, then those between: halves that see the same.
    pub frames: Vec<Frame>,
    /// Whether the files measure depth along the optical axis.
    pub along_z: bool,
    /// How frames become points, but for the calibration.
    pub surface: SurfaceSettings,
    /// The corrections that the search begins with.
    pub calibration: Calibration,
    /// Structural scale, world units.
    pub h: f64,
    /// Every so-many-th pixel of every so-many-th row is looked at.
    pub step: usize,
}

impl CalibrationInput {
    /// How frames become points with other depth and a colour camera.
    pub fn settings(
        &self,
        [depth_offset, depth_scale]: [f64; 2],
        color_camera: Option<ColorCamera>,
    ) -> SurfaceSettings {
        let calibration =
            Calibration { color_camera, depth_offset, depth_scale, ..self.calibration.clone() };
        SurfaceSettings {
            calibration: Some(calibration),
            // Steps of its own choose pixels.
            sampling: PixelSampling::Every,
            ..self.surface.clone()
        }
    }

    /// Brings the points of frames together. `growth` times the structural scale is that of the components.
    ///
    /// # Errors
    /// A frame without depth.
    pub fn matched(
        &self,
        frames: &[Frame],
        depth: [f64; 2],
        color_camera: Option<ColorCamera>,
        growth: f64,
    ) -> Result<Matches, FrameError> {
        let settings = self.settings(depth, color_camera);
        let depth = MatchedDepth { values: depth, along_z: self.along_z };
        Matches::new(frames, &settings, depth, (growth * self.h, self.step))
    }
}
