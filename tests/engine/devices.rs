//! Passes of the mixture on stub devices: training gives the same bits as on the CPU alone.

use super::common::wavy::wavy_frame;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::model::inspection::DeviceError;
use vbgs_studio::model::paper::mixture_device::{
    DevicePass, MeanCells, MixtureDevice, PassRule, PointColumns,
};
use vbgs_studio::train::device_trial::DevicePolicy;
use vbgs_studio::train::device_trial::PassUse;
use vbgs_studio::train::learner::TrainingDevice;
use vbgs_studio::train::paper::config::{PaperConfig, PaperOverrides};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;

const FRAMES: usize = 4;

/// Stub that leaves all tiles or none to the CPU, and fails after `passes_left` passes.
struct Idle {
    leaves_all: bool,
    passes_left: usize,
    q: Vec<f32>,
    tiles: Vec<u32>,
}

impl MixtureDevice for Idle {
    fn name(&self) -> String {
        "card".to_owned()
    }

    fn set_means(&mut self, _: &MeanCells<'_>) -> Result<(), DeviceError> {
        Ok(())
    }

    fn set_points(&mut self, points: &PointColumns<'_>) -> Result<(), DeviceError> {
        self.q = vec![0.5; points.columns[0].len()];
        let n_tiles = if self.leaves_all { points.tiles.len() as u32 - 1 } else { 0 };
        // Devices may return the tiles in any order.
        self.tiles = (0..n_tiles).rev().collect();
        Ok(())
    }

    fn pass(&mut self, _: &PassRule, _: bool) -> Result<DevicePass<'_>, DeviceError> {
        let gone = DeviceError { device: self.name(), reason: "gone".to_owned() };
        self.passes_left = self.passes_left.checked_sub(1).ok_or(gone)?;
        Ok(DevicePass { q: &self.q, open: &self.tiles, records: &[] })
    }
}

/// Trains with the stub, compares every frame with the CPU alone, and returns the device's use.
fn used(leaves_all: bool, passes_left: usize, policy: DevicePolicy) -> PassUse {
    let asked = PaperOverrides { components: Some(1000), ..PaperOverrides::default() };
    let config = PaperConfig::paper().with(&asked).unwrap();
    let draw = InitialDraw::random(config.components, config.seed);
    let begin = || learner::begin(&config, &draw, Normalization::IDENTITY).unwrap();
    let (mut alone, mut beside) = (begin(), begin());
    let idle = Idle { leaves_all, passes_left, q: Vec::new(), tiles: Vec::new() };
    beside.add_device(TrainingDevice::Passes(Box::new(idle)), policy).unwrap();
    for t in 0..FRAMES {
        let points = wavy_frame(0.2 * t as f32, 9);
        let outcomes = [&mut alone, &mut beside].map(|learner| learner.learn(&points).unwrap());
        assert_eq!(outcomes[0].elbo_mean, outcomes[1].elbo_mean);
        assert_eq!(alone.point_elbo(), beside.point_elbo());
        assert!(alone.state() == beside.state());
    }
    beside.device_use().passes.unwrap()
}

#[test]
fn what_a_device_leaves_open_is_the_processors() {
    let idle = used(true, usize::MAX, DevicePolicy::Device);
    assert_eq!((idle.device_frames, idle.processor_frames, idle.given_up), (3, 1, None));
    assert_eq!((idle.device.as_deref(), idle.open_share), (Some("card"), 1.0));
    let tried = used(true, usize::MAX, DevicePolicy::Fastest);
    assert_eq!((tried.device_frames, tried.processor_frames), (0, 4), "four frames are the trial");
    assert!(tried.trial.is_some_and(|ms| ms.device > 0.0 && ms.processor > 0.0));
}

#[test]
fn a_device_of_other_arithmetic_is_given_up_before_it_counts() {
    let wrong = used(false, usize::MAX, DevicePolicy::Device);
    assert_eq!((wrong.device_frames, wrong.processor_frames), (0, 4));
    assert_eq!(wrong.given_up.as_deref(), Some("its arithmetic differs from the CPU's"));
}

#[test]
fn the_very_frame_that_a_device_fails_at_is_learnt() {
    // The device fits frame 1 beside the CPU and frame 2 alone. Scoring the points of frame 3 precedes its
    // fit, so the device fails there.
    let lost = used(true, 2, DevicePolicy::Device);
    assert_eq!((lost.device_frames, lost.processor_frames), (1, 3));
    assert_eq!(lost.given_up.as_deref(), Some("gone"));
}
