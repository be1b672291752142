//! Exposures of a scene's training frames, so that a view can be drawn as bright as a camera there would have
//! recorded it.

use super::viewpoint::{Viewpoint, interpolate, reach};
use crate::math::pose::Pose;
use bytemuck::{Pod, Zeroable};

/// Exposure and viewpoint of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameExposure {
    /// Camera viewpoint.
    pub viewpoint: Viewpoint,
    /// Factors from the frame's red, green and blue to the scene's.
    pub gain: [f64; 3],
}

impl FrameExposure {
    /// Creates the entry of a frame taken from `pose` with the gain that gives the scene's exposure.
    pub fn new(pose: &Pose, gain: [f32; 3]) -> Self {
        Self { viewpoint: Viewpoint::new(pose), gain: gain.map(f64::from) }
    }

    /// Moves the viewpoint with the world: `motion` maps old to new coordinates.
    pub fn moved(&self, motion: &Pose) -> Self {
        Self { viewpoint: self.viewpoint.moved(motion), ..*self }
    }
}

/// Exposures of a scene's frames in training order.
///
/// ```
/// use vbgs_studio::math::pose::Pose;
/// use vbgs_studio::model::splat::exposure::{ExposureLog, FrameExposure};
///
/// // A frame half as bright in red as the scene.
/// let frame = FrameExposure::new(&Pose::IDENTITY, [2.0, 1.0, 1.0]);
/// let log = ExposureLog::new(vec![frame], 0.02);
/// let [red, green, _] = log.at(&Pose::IDENTITY);
/// assert!((red - 0.5).abs() < 1e-6 && (green - 1.0).abs() < 1e-6);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct ExposureLog {
    frames: Vec<FrameExposure>,
    /// Distance between cameras at which exposures correlate by one half, world units.
    reach: f64,
}

impl ExposureLog {
    /// Creates the log of a scene with structural scale `h`, world units.
    pub fn new(frames: Vec<FrameExposure>, h: f64) -> Self {
        Self { frames, reach: reach(h) }
    }

    /// Returns factors on the scene's red, green and blue as seen from `pose`: the inverse gains of nearby
    /// frames, interpolated between them ([`regress`]); 1 without frames.
    pub fn at(&self, pose: &Pose) -> [f32; 3] {
        // Logarithms, since gains are factors: half and twice as bright average to 1.
        let said = |frame: &FrameExposure| (frame.viewpoint, frame.gain.map(|gain| -gain.ln()));
        let logs = interpolate(&self.frames, pose, self.reach, said);
        logs.map_or([1.0; 3], |logs| logs.map(|log| log.exp() as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn looking(x: f64) -> Pose {
        Pose::look_at(DVec3::new(x, 0.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::Z).unwrap()
    }

    fn log(frames: &[(f64, f32)]) -> ExposureLog {
        let frames =
            frames.iter().map(|&(x, gain)| FrameExposure::new(&looking(x), [gain, 1.0, 1.0]));
        ExposureLog::new(frames.collect(), 0.025)
    }

    #[test]
    fn views_are_as_bright_as_the_frames_around_them() {
        let log = log(&[(0.0, 0.5), (0.1, 2.0), (50.0, 1.0)]);
        let red = |x: f64| log.at(&looking(x))[0];
        assert!((red(0.05) - 1.0).abs() < 1e-6, "half way between the first two");
        assert!((red(50.0) - 1.0).abs() < 0.02 && (red(-50.0) - 1.0).abs() < 1e-6);
        assert!(red(0.0) > red(0.02) && red(0.02) > red(0.08) && red(0.08) > red(0.1));
        assert!(red(0.0) > 1.5 && red(0.1) < 1.0 / 1.5, "{} {}", red(0.0), red(0.1));
        assert_eq!(log.at(&looking(0.0))[1], 1.0);
    }

    #[test]
    fn nothing_is_known_of_no_frames() {
        assert_eq!(log(&[]).at(&looking(0.0)), [1.0; 3]);
    }
}
