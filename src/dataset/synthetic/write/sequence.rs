//! All views of a plan one after the other, for layouts that know no splits.

use crate::dataset::synthetic::plan::ViewPlan;
use crate::dataset::synthetic::view::SyntheticView;
use crate::math::camera::Intrinsics;
use crate::math::image::Image;
use crate::math::pose::Pose;
use glam::DQuat;

/// Frames a second of the recorder that never was.
pub(super) const FRAMES_PER_SECOND: f64 = 30.0;
/// Seconds on its clock when it began.
const START: f64 = 1000.0;
/// How much smaller than a photograph a phone's depth is.
const PHONE_FACTOR: u32 = 4;
/// Smallest side of depth.
const MIN_SIDE: u32 = 8;

/// One frame of a sequence.
pub(super) struct SequenceFrame<'a> {
    /// From 0.
    pub index: usize,
    /// Seconds.
    pub time: f64,
    pub pose: Pose,
    plan: &'a ViewPlan,
    place: (usize, usize),
}

/// The views of all splits in order.
pub(super) fn frames(plan: &ViewPlan) -> impl Iterator<Item = SequenceFrame<'_>> {
    let poses = plan.splits.iter().enumerate().flat_map(|(s, split)| {
        split.poses.iter().enumerate().map(move |(i, pose)| ((s, i), *pose))
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

    /// Colours by the scene's own camera, depth by another of the same pose.
    pub fn views(&self, depth: &Intrinsics) -> (Image<[u8; 4]>, Image<f64>) {
        let (split, i) = self.place;
        let of_depth = self.plan.view_by(&self.plan.splits[split], i, *depth);
        (self.view().color, of_depth.depth_z)
    }

    /// Quaternion of the pose in OpenCV or OpenGL axes.
    pub fn turn(&self, is_opengl: bool) -> DQuat {
        let matrix = if is_opengl { self.pose.to_opengl() } else { self.pose.to_opencv() };
        DQuat::from_mat4(&matrix)
    }
}

/// The camera of a phone's depth: the photograph's lens, an image a quarter as wide.
pub(super) fn phone_depth(k: &Intrinsics) -> Intrinsics {
    let side = |n: u32| (n / PHONE_FACTOR).max(MIN_SIDE);
    let (width, height) = (side(k.width), side(k.height));
    let sx = f64::from(width) / f64::from(k.width);
    let sy = f64::from(height) / f64::from(k.height);
    Intrinsics { width, height, fx: k.fx * sx, fy: k.fy * sy, cx: k.cx * sx, cy: k.cy * sy }
}

/// Nine numbers of a camera matrix by columns.
pub(super) fn by_columns(k: &Intrinsics) -> [f64; 9] {
    [k.fx, 0.0, 0.0, 0.0, k.fy, 0.0, k.cx, k.cy, 1.0]
}
