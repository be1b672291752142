//! Input of a calibration: frames and the initial camera calibration.

use super::matches::{MatchedDepth, Matches};
use crate::dataset::calibration::{Calibration, ColorCamera};
use crate::dataset::error::FrameError;
use crate::dataset::frame::Frame;
use crate::dataset::surface::{PixelSampling, SurfaceSettings};

pub(super) struct CalibrationInput {
    /// Even-numbered frames first, then odd-numbered: two halves that see the same places.
    pub frames: Vec<Frame>,
    /// True if depth is measured along the optical axis, false along the ray.
    pub along_z: bool,
    /// Surface preparation, without the calibration.
    pub surface: SurfaceSettings,
    pub calibration: Calibration,
    /// Structural scale, world units.
    pub h: f64,
    /// Pixel stride in columns and rows.
    pub step: usize,
}

impl CalibrationInput {
    /// Surface preparation with another depth calibration and colour camera.
    pub fn settings(
        &self,
        [depth_offset, depth_scale]: [f64; 2],
        color_camera: Option<ColorCamera>,
    ) -> SurfaceSettings {
        let calibration =
            Calibration { color_camera, depth_offset, depth_scale, ..self.calibration.clone() };
        SurfaceSettings {
            calibration: Some(calibration),
            // Pixels are subsampled by `step` instead.
            sampling: PixelSampling::Every,
            ..self.surface.clone()
        }
    }

    /// Matches the points of frames by components of `growth` times the structural scale.
    ///
    /// # Errors
    /// A frame without depth.
    pub fn match_frames(
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
