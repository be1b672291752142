//! Corrections of the recorded poses of a scene's training frames. With them, a view recorded among
//! these frames can be drawn from its corrected pose.

use super::viewpoint::{Viewpoint, interpolate, reach};
use crate::math::pose::{Pose, unit_rotation};
use bytemuck::{Pod, Zeroable};
use glam::{DQuat, DVec3};

/// Pose correction of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FramePose {
    /// Viewpoint of the recorded pose.
    pub recorded: Viewpoint,
    /// Rotation from the recorded camera's OpenCV axes to the world's: unit quaternion x, y, z, w. Zeros
    /// if the rotation is unknown, as in older checkpoints.
    pub rotation: [f64; 4],
    /// Rotation from the recorded to the corrected camera: axis times angle in the recorded camera's frame,
    /// radians.
    pub turn: [f64; 3],
    /// Position of the corrected camera in the recorded camera's frame, world units.
    pub shift: [f64; 3],
}

impl FramePose {
    /// Creates the correction of a frame from its recorded and its corrected pose.
    pub fn new(recorded: &Pose, real: &Pose) -> Self {
        let (shift, turn) = recorded.offset_to(real);
        Self {
            recorded: Viewpoint::new(recorded),
            rotation: DQuat::from_mat3(&recorded.rotation()).normalize().to_array(),
            turn: turn.to_scaled_axis().to_array(),
            shift: shift.to_array(),
        }
    }

    /// Returns the recorded and the corrected pose; `None` if the recorded rotation is unknown.
    pub fn poses(&self) -> Option<[Pose; 2]> {
        let rotation = unit_rotation(self.rotation)?;
        let turn = DQuat::from_scaled_axis(DVec3::from_array(self.turn));
        let recorded =
            Pose::IDENTITY.attached_camera(DVec3::from_array(self.recorded.centre), rotation);
        Some([recorded, recorded.attached_camera(DVec3::from_array(self.shift), turn)])
    }

    /// Returns the correction with both poses moved by a rigid motion of the world, from old to new coordinates.
    /// `None` if the recorded rotation is unknown.
    pub fn transformed_by(&self, motion: &Pose) -> Option<Self> {
        let [recorded, real] = self.poses()?.map(|pose| pose.transformed_by(motion));
        Some(Self::new(&recorded, &real))
    }

    /// Returns the correction after a rigid motion of the world, which moves the corrected pose; the
    /// recorded pose stays fixed. `motion` maps old to new world coordinates. `None` if the recorded
    /// rotation is unknown.
    pub fn moved(&self, motion: &Pose) -> Option<Self> {
        let [recorded, real] = self.poses()?;
        let Self { turn, shift, .. } = Self::new(&recorded, &real.transformed_by(motion));
        Some(Self { turn, shift, ..*self })
    }
}

/// Pose corrections of a scene's frames in training order.
///
/// ```
/// use glam::{DQuat, DVec3};
/// use vbgs_studio::math::pose::Pose;
/// use vbgs_studio::model::splat::pose_log::{FramePose, PoseLog};
///
/// let real = Pose::IDENTITY.attached_camera(DVec3::new(0.01, 0.0, 0.0), DQuat::IDENTITY);
/// let log = PoseLog::new(vec![FramePose::new(&Pose::IDENTITY, &real)], 0.03);
/// assert!((log.at(&Pose::IDENTITY).centre() - real.centre()).length() < 1e-12);
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct PoseLog {
    frames: Vec<FramePose>,
    /// Distance between cameras at which corrections correlate by one half, world units.
    reach: f64,
}

impl PoseLog {
    /// Creates the log of a scene with structural scale `h`, world units.
    pub fn new(frames: Vec<FramePose>, h: f64) -> Self {
        Self { frames, reach: reach(h) }
    }

    /// Returns the frames in training order.
    pub fn frames(&self) -> &[FramePose] {
        &self.frames
    }

    /// Returns the corrected pose of a camera recorded at `pose` (see [`corrected`]).
    pub fn at(&self, pose: &Pose) -> Pose {
        corrected(&self.frames, self.reach, pose)
    }
}

/// Returns the corrected pose of a camera recorded at `pose`; the recorded pose if there are no frames.
/// The corrections of nearby frames are interpolated and applied in the camera's frame. `reach` is the
/// distance between cameras at which corrections correlate by one half, world units.
pub fn corrected(frames: &[FramePose], reach: f64, pose: &Pose) -> Pose {
    let entry = |frame: &FramePose| {
        let [a, b, c] = frame.turn;
        let [x, y, z] = frame.shift;
        (frame.recorded, [a, b, c, x, y, z])
    };
    match interpolate(frames, pose, reach, entry) {
        None => *pose,
        Some([a, b, c, x, y, z]) => {
            let turn = DQuat::from_scaled_axis(DVec3::new(a, b, c));
            pose.attached_camera(DVec3::new(x, y, z), turn)
        }
    }
}

/// Exposure and viewpoint of one frame.
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameExposure {
    /// Camera viewpoint.
    pub viewpoint: Viewpoint,
    /// Factors that convert the frame's red, green and blue to the scene's exposure.
    pub gain: [f64; 3],
}

impl FrameExposure {
    /// Creates the entry of a frame taken from `pose`. `gain` converts the frame's colours to the
    /// scene's exposure.
    pub fn new(pose: &Pose, gain: [f32; 3]) -> Self {
        Self { viewpoint: Viewpoint::new(pose), gain: gain.map(f64::from) }
    }

    /// Returns the entry with its viewpoint moved by `motion`, which maps old to new world coordinates.
    pub fn moved(&self, motion: &Pose) -> Self {
        Self { viewpoint: self.viewpoint.moved(motion), ..*self }
    }
}

/// Exposures of a scene's frames in training order.
///
/// ```
/// use vbgs_studio::math::pose::Pose;
/// use vbgs_studio::model::splat::pose_log::{ExposureLog, FrameExposure};
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
    /// Distance between cameras at which the correlation of their exposures is one half, world units.
    reach: f64,
}

impl ExposureLog {
    /// Creates the log of a scene with structural scale `h`, world units.
    pub fn new(frames: Vec<FrameExposure>, h: f64) -> Self {
        Self { frames, reach: reach(h) }
    }

    /// Returns factors on the scene's red, green and blue as seen from `pose`; 1 if there are no
    /// frames. They are the inverse gains of nearby frames, interpolated by [`interpolate`].
    pub fn at(&self, pose: &Pose) -> [f32; 3] {
        // Logarithms, since gains are factors: half and twice as bright average to 1.
        let entry = |frame: &FrameExposure| (frame.viewpoint, frame.gain.map(|gain| -gain.ln()));
        let logs = interpolate(&self.frames, pose, self.reach, entry);
        logs.map_or([1.0; 3], |logs| logs.map(|log| log.exp() as f32))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn views_move_as_the_frames_around_them() {
        let recorded =
            |x: f64| Pose::look_at(DVec3::new(x, 0.0, 0.0), DVec3::new(x, 1.0, 0.0), DVec3::Z);
        let frame = |x: f64, right: f64, turn: f64| {
            let recorded = recorded(x).unwrap();
            let real = recorded.attached_camera(DVec3::X * right, DQuat::from_rotation_y(turn));
            FramePose::new(&recorded, &real)
        };
        let log = PoseLog::new(vec![frame(0.0, 0.02, 0.01), frame(0.1, 0.04, 0.03)], 0.025);
        let moved = |x: f64| {
            let recorded = recorded(x).unwrap();
            FramePose::new(&recorded, &log.at(&recorded))
        };
        let between = moved(0.05);
        assert!((between.shift[0] - 0.03).abs() < 1e-9 && (between.turn[1] - 0.02).abs() < 1e-6);
        let [near, far] = [0.0, -50.0].map(|x| moved(x).shift[0]);
        assert!((near - 0.02).abs() < 4e-3 && (far - 0.03).abs() < 1e-9, "{near} {far}");
        let alone = PoseLog::new(Vec::new(), 0.025);
        assert_eq!(alone.at(&recorded(0.3).unwrap()), recorded(0.3).unwrap());
    }

    #[test]
    fn a_correction_moves_with_the_world() {
        let recorded = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        let real = recorded.attached_camera(DVec3::X * 0.1, DQuat::from_rotation_y(0.02));
        let world = Pose::IDENTITY.attached_camera(DVec3::Y, DQuat::from_rotation_z(0.5));
        let moved = FramePose::new(&recorded, &real).transformed_by(&world).unwrap();
        let [from, to] = moved.poses().unwrap();
        for (found, before) in [(from, recorded), (to, real)] {
            let expected = before.transformed_by(&world);
            assert!((found.centre() - expected.centre()).length() < 1e-12);
            assert!((found.forward() - expected.forward()).length() < 1e-12);
        }
        assert!((moved.shift[0] - 0.1).abs() < 1e-12, "the motion is in the camera's frame");
    }

    #[test]
    fn a_correction_gives_the_real_pose_back() {
        let recorded = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        let turn = DQuat::from_scaled_axis(DVec3::new(0.02, -0.01, 0.03));
        let real = recorded.attached_camera(DVec3::new(0.01, -0.02, 0.03), turn);
        let found = PoseLog::new(vec![FramePose::new(&recorded, &real)], 0.1).at(&recorded);
        assert!((found.centre() - real.centre()).length() < 1e-12);
        let apart = found.rotation() - real.rotation();
        assert!(apart.to_cols_array().iter().all(|x| x.abs() < 1e-12));
    }
}

#[cfg(test)]
mod exposure_tests {
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
