//! Recordings with poses that are wrong on purpose, and how much of that is left once a scene has corrected
//! them (`pipeline.md`, Recordings bench).

use crate::dataset::Dataset;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use crate::model::splat::pose_log::FramePose;
use crate::pipeline::plan::Plan;
use glam::{DQuat, DVec3};
use std::sync::Arc;

/// One of so many frames is perturbed, and not the first of them: where that stands the scene begins.
const ONE_OF: usize = 10;
const WHICH: usize = 5;
/// Distance that a camera is moved by, metres.
const SHIFT: f64 = 0.02;
/// Angle that it is turned by, radians.
const TURN: f64 = std::f64::consts::PI / 180.0;
/// Share of that distance within which two recorded places are one.
const SAME: f64 = 1e-6;

/// A recording with poses that are wrong on purpose.
pub struct Perturbed {
    /// The recording.
    pub dataset: Arc<Dataset>,
    /// The poses that were changed: as recorded, and as they are now.
    changed: Vec<[Pose; 2]>,
}

impl Perturbed {
    /// The dataset with every tenth frame of a plan, as it is learnt, moved by 2 cm and turned by a degree, each in
    /// a direction of its own.
    pub fn new(dataset: &Dataset, plan: &Plan, seed: u64) -> Self {
        let (mut dataset, mut changed) = (dataset.clone(), Vec::new());
        let shift = SHIFT * dataset.units_per_metre();
        let mut rng = Rng::new(seed, Purpose::Synthetic, plan.frames.len() as u64);
        let mut direction = || loop {
            let within = DVec3::from_array([0; 3].map(|_| rng.range(-1.0, 1.0)));
            if let Some(unit) = within.try_normalize().filter(|_| within.length() <= 1.0) {
                return unit;
            }
        };
        let frames = &mut dataset.splits[plan.split].frames;
        for &frame in plan.frames.iter().skip(WHICH).step_by(ONE_OF) {
            let [to, axis] = [direction(), direction()];
            let pose = &mut frames[frame].camera.pose;
            let wrong = pose.attached_camera(shift * to, DQuat::from_axis_angle(axis, TURN));
            changed.push([std::mem::replace(pose, wrong), wrong]);
        }
        Self { dataset: Arc::new(dataset), changed }
    }

    /// Shares of shift and turn that are left: how far perturbed frames stand, in the mean, from where those of a
    /// run without perturbations do. `None` where no such frame was learnt in both.
    pub fn left(&self, without: &[FramePose], with: &[FramePose]) -> Option<[f64; 2]> {
        let shift = SHIFT * self.dataset.units_per_metre();
        let real = |log: &[FramePose], recorded: &Pose| {
            let is_it = |frame: &&FramePose| {
                recorded.centre().distance(DVec3::from_array(frame.recorded.centre)) < SAME * shift
            };
            log.iter().find(is_it).and_then(FramePose::poses).map(|[_, real]| real)
        };
        let apart = |[recorded, wrong]: &[Pose; 2]| {
            let (shifted, turned) = real(without, recorded)?.offset_to(&real(with, wrong)?);
            Some([shifted.length() / shift, turned.to_scaled_axis().length() / TURN])
        };
        let apart: Vec<[f64; 2]> = self.changed.iter().filter_map(apart).collect();
        let mean = |i: usize| apart.iter().map(|left| left[i]).sum::<f64>() / apart.len() as f64;
        (!apart.is_empty()).then(|| [mean(0), mean(1)])
    }
}
