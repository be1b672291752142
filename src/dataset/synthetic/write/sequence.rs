//! Recorded frames of a plan as one sequence, for layouts without splits.

use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DQuat;

/// Frame rate of the simulated recorder, hertz.
pub(super) const FRAMES_PER_SECOND: f64 = 30.0;
/// Time stamp of the first frame, seconds.
const START: f64 = 1000.0;

pub(super) struct SequenceFrame<'a> {
    pub index: usize,
    /// Time stamp, seconds.
    pub time: f64,
    /// Pose as stated by the recording.
    pub pose: Pose,
    plan: &'a ViewPlan,
    place: (usize, usize),
}

/// Iterates over the frames of all recorded splits in order.
pub(super) fn frames(plan: &ViewPlan) -> impl Iterator<Item = SequenceFrame<'_>> {
    let recorded = plan.splits.iter().enumerate().filter(|(_, split)| split.is_recorded);
    let poses = recorded.flat_map(|(s, split)| {
        split.recorded_poses.iter().enumerate().map(move |(i, pose)| ((s, i), *pose))
    });
    poses.enumerate().map(move |(index, (place, pose))| {
        let time = START + index as f64 / FRAMES_PER_SECOND;
        SequenceFrame { index, time, pose, plan, place }
    })
}

impl SequenceFrame<'_> {
    /// Renders colour and depth with the scene's camera.
    pub fn view(&self) -> SyntheticView {
        let (split, i) = self.place;
        self.plan.render_view(&self.plan.splits[split], i)
    }

    /// Renders colour with the scene's camera and depth with the plan's depth camera.
    pub fn capture(&self) -> Capture {
        let (split, i) = self.place;
        self.plan.render_capture(&self.plan.splits[split], i)
    }

    /// Renders colour with the scene's camera, and depth with the intrinsics `depth` at the same pose.
    pub fn view_by(&self, depth: Intrinsics) -> SyntheticView {
        let (split, i) = self.place;
        let of_depth = self.plan.view_by(&self.plan.splits[split], i, depth);
        SyntheticView { color: self.view().color, ..of_depth }
    }

    /// Rotation of the pose as a quaternion, in OpenGL or OpenCV axes.
    pub fn rotation_quaternion(&self, is_opengl: bool) -> DQuat {
        let matrix = if is_opengl { self.pose.to_opengl() } else { self.pose.to_opencv() };
        DQuat::from_mat4(&matrix)
    }
}

/// Camera matrix as nine numbers in column-major order.
pub(super) fn column_major_matrix(k: &Intrinsics) -> [f64; 9] {
    [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0]
}
