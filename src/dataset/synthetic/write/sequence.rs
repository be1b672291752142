//! The recorded views of a plan one after the other, for layouts that know no splits.

use crate::dataset::synthetic::phone::camera::Capture;
use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use crate::math::pose::Pose;
use glam::DQuat;

/// Frames a second of the recorder that never was.
pub(super) const FRAMES_PER_SECOND: f64 = 30.0;
/// Seconds on its clock when it began.
const START: f64 = 1000.0;

/// One frame of a sequence.
pub(super) struct SequenceFrame<'a> {
    /// From 0.
    pub index: usize,
    /// Seconds.
    pub time: f64,
    /// As the recording states it.
    pub pose: Pose,
    plan: &'a ViewPlan,
    place: (usize, usize),
}

/// The views of all recorded splits in order.
pub(super) fn frames(plan: &ViewPlan) -> impl Iterator<Item = SequenceFrame<'_>> {
    let recorded = plan.splits.iter().enumerate().filter(|(_, split)| split.is_recorded);
    let poses = recorded.flat_map(|(s, split)| {
        split.stated.iter().enumerate().map(move |(i, pose)| ((s, i), *pose))
    });
    poses.enumerate().map(move |(index, (place, pose))| {
        let time = START + index as f64 / FRAMES_PER_SECOND;
        SequenceFrame { index, time, pose, plan, place }
    })
}

impl SequenceFrame<'_> {
    /// Colour and depth by the scene's own camera.
    pub fn view(&self) -> SyntheticView {
        let (split, i) = self.place;
        self.plan.view(&self.plan.splits[split], i)
    }

    /// Colours by the scene's own camera, depth by the plan's depth camera.
    pub fn capture(&self) -> Capture {
        let (split, i) = self.place;
        self.plan.capture(&self.plan.splits[split], i)
    }

    /// Colours by the scene's own camera, exact depth by another of the same pose.
    pub fn view_by(&self, depth: Intrinsics) -> SyntheticView {
        let (split, i) = self.place;
        let of_depth = self.plan.view_by(&self.plan.splits[split], i, depth);
        SyntheticView { color: self.view().color, ..of_depth }
    }

    /// Quaternion of the pose in OpenCV or OpenGL axes.
    pub fn turn(&self, is_opengl: bool) -> DQuat {
        let matrix = if is_opengl { self.pose.to_opengl() } else { self.pose.to_opencv() };
        DQuat::from_mat4(&matrix)
    }
}

/// Nine numbers of a camera matrix by columns.
pub(super) fn by_columns(k: &Intrinsics) -> [f64; 9] {
    [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0]
}
