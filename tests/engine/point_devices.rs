//! Fitting the points of a scene on stub devices: training gives the same bits as on the CPU alone.

use glam::DVec3;
use vbgs_studio::model::inspection::DeviceError;
use vbgs_studio::model::scene::points_device::{
    LEFT_TO_PROCESSOR, POINT_WORDS, PointsDevice, Seeds, SlotSums,
};
use vbgs_studio::model::scene::sums::N_SUMS;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::train::device_trial::DevicePolicy;
use vbgs_studio::train::device_trial::PassUse;
use vbgs_studio::train::learner::{Learner, Learns, TrainingDevice};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::trainer::SceneTrainer;

const FRAMES: usize = 4;

/// Stub that returns the same seed for every point and zero sums, and fails after `sums_left` calls.
struct Idle {
    seed: u32,
    sums_left: usize,
    seeds: Vec<u32>,
    sums: Vec<[i32; N_SUMS]>,
}

impl PointsDevice for Idle {
    fn name(&self) -> String {
        "card".to_owned()
    }

    fn set_seeds(&mut self, _: &Seeds<'_>) -> Result<(), DeviceError> {
        Ok(())
    }

    fn set_points(&mut self, points: &[[u32; POINT_WORDS]]) -> Result<(), DeviceError> {
        self.seeds = vec![self.seed; points.len()];
        Ok(())
    }

    fn nearest(&mut self) -> Result<&[u32], DeviceError> {
        Ok(&self.seeds)
    }

    fn sums(&mut self, asked: &SlotSums<'_>) -> Result<&[[i32; N_SUMS]], DeviceError> {
        let gone = DeviceError { device: self.name(), reason: "gone".to_owned() };
        self.sums_left = self.sums_left.checked_sub(1).ok_or(gone)?;
        self.sums = vec![[0; N_SUMS]; asked.seeds.len()];
        Ok(&self.sums)
    }
}

/// Wall that recedes from frame to frame. Devices leave points whose normals are not of length 1 to the CPU.
fn wall(t: usize, length: f32) -> Observation {
    let point = |i: usize| SurfacePoint {
        position: [(i % 50) as f32 * 0.01, (i / 50) as f32 * 0.01, 1.0 + 0.03 * t as f32],
        range: 1.0,
        normal: [0.0, 0.0, -length],
        direction: [0.0, 0.0, 1.0],
        ..SurfacePoint::default()
    };
    Observation { points: (0..2000).map(point).collect(), ..Observation::empty() }
}

/// Trains with the stub, compares every frame with the CPU alone, and returns the device's use.
fn used(seed: u32, sums_left: usize, length: f32, policy: DevicePolicy) -> PassUse {
    let begin = || SceneTrainer::new(&SceneConfig::fine(0.05), DVec3::ZERO);
    let (mut alone, mut beside) = (begin(), begin());
    let idle = Idle { seed, sums_left, seeds: Vec::new(), sums: Vec::new() };
    beside.add_device(TrainingDevice::Points(Box::new(idle)), policy).unwrap();
    for t in 0..FRAMES {
        let frame = wall(t, length);
        let outcomes = [&mut alone, &mut beside].map(|learner| learner.learn(&frame).unwrap());
        assert_eq!(outcomes[0].elbo_mean, outcomes[1].elbo_mean);
        assert_eq!(alone.last_frame().changed, beside.last_frame().changed);
        assert!(alone.checkpoint_model() == beside.checkpoint_model());
    }
    beside.device_use().points.unwrap()
}

fn counts(used: &PassUse) -> (u64, u64, Option<&str>) {
    (used.device_frames, used.processor_frames, used.given_up.as_deref())
}

#[test]
fn what_a_device_leaves_open_is_the_processors() {
    let idle = used(LEFT_TO_PROCESSOR, usize::MAX, 3.0, DevicePolicy::Device);
    assert_eq!((counts(&idle), idle.open_share), ((3, 1, None), 1.0));
    assert_eq!(idle.device.as_deref(), Some("card"));
    let tried = used(LEFT_TO_PROCESSOR, usize::MAX, 3.0, DevicePolicy::Fastest);
    assert_eq!(counts(&tried), (0, 4, None), "four frames are the trial");
    assert!(tried.trial.is_some_and(|ms| ms.device > 0.0 && ms.processor > 0.0));
}

#[test]
fn a_device_of_other_arithmetic_is_given_up_before_it_counts() {
    // The first device errs in its sums, the second in its seeds.
    for (seed, length) in [(LEFT_TO_PROCESSOR, 1.0), (0, 3.0)] {
        let wrong = used(seed, usize::MAX, length, DevicePolicy::Device);
        assert_eq!(counts(&wrong), (0, 4, Some("its arithmetic differs from the CPU's")));
    }
}

#[test]
fn the_very_frame_that_a_device_fails_at_is_learnt() {
    // The device fails in the third frame, after it returned the seeds.
    let lost = used(LEFT_TO_PROCESSOR, 2, 3.0, DevicePolicy::Device);
    assert_eq!(counts(&lost), (1, 3, Some("gone")));
}
