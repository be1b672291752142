//! Training of the published algorithm on a GPU gives the CPU's bits, for any input and after a
//! device failure.

use super::common::wavy::wavy_frame;
use super::fixture::Fixture;
use vbgs_studio::math::measured_pixel::Normalization;
use vbgs_studio::observation::points::Points;
use vbgs_studio::render::gpu::mixture::GpuMixture;
use vbgs_studio::train::device_trial::DevicePolicy;
use vbgs_studio::train::device_trial::PassUse;
use vbgs_studio::train::learner::TrainingDevice;
use vbgs_studio::train::paper::config::{
    Candidates, Init, PaperConfig, PaperOverrides, ReassignPolicy,
};
use vbgs_studio::train::paper::init::InitialDraw;
use vbgs_studio::train::paper::learner;
use vbgs_studio::train::paper::learner::PaperLearner;
use vbgs_studio::train::timing::{PAPER_STAGES, StageMs};

/// Tiles per side of a frame.
const SIDE: usize = 12;
const FRAMES: usize = 4;

fn mixture(fixture: &Fixture) -> GpuMixture {
    GpuMixture::new(fixture.headless())
}

fn frames() -> Vec<Points<f32>> {
    (0..FRAMES).map(|t| wavy_frame(0.3 * t as f32, SIDE)).collect()
}

/// A learner with padded reassignment and 3,000 components, unless overridden.
fn begun(asked: &PaperOverrides, first: &Points<f32>) -> Box<dyn PaperLearner> {
    let overrides = PaperOverrides { components: asked.components.or(Some(3000)), ..asked.clone() };
    let config = PaperConfig::paper().with(&overrides).unwrap();
    let draw = match config.init {
        Init::Random => InitialDraw::random(config.components, config.seed),
        Init::Data => InitialDraw::from_points(first, config.components, config.seed),
    };
    learner::begin(&config, &draw, Normalization::IDENTITY).unwrap()
}

/// Trains on the GPU and on the CPU and compares after every frame. `before` runs before each frame
/// and may break the device.
fn compared(
    gpu: &Fixture,
    asked: &PaperOverrides,
    frames: &[Points<f32>],
    before: impl Fn(usize),
) -> PassUse {
    let [mut alone, mut beside] = [(); 2].map(|()| begun(asked, &frames[0]));
    beside
        .add_device(TrainingDevice::Passes(Box::new(mixture(gpu))), DevicePolicy::Device)
        .unwrap();
    let bits = |learner: &dyn PaperLearner| -> Vec<u64> {
        learner.point_elbo().into_iter().map(f64::to_bits).collect()
    };
    for (i, points) in frames.iter().enumerate() {
        before(i);
        let expected = alone.learn(points).unwrap();
        let found = beside.learn(points).unwrap();
        assert_eq!(
            (found.points, found.reassigned, found.elbo_mean.to_bits()),
            (expected.points, expected.reassigned, expected.elbo_mean.to_bits()),
            "{asked:?}, frame {i}"
        );
        assert!(bits(&*beside) == bits(&*alone), "{asked:?}: scores of frame {i}");
        assert!(beside.state() == alone.state(), "{asked:?}: sums of frame {i}");
    }
    beside.device_use().passes.unwrap()
}

fn counts(used: &PassUse) -> [u64; 2] {
    [used.device_frames, used.processor_frames]
}

/// Frames of the device and of the CPU: both compute the first frame, and the CPU's result is used.
const ALL_OF_THEM: [u64; 2] = [FRAMES as u64 - 1, 1];

#[test]
fn every_policy_trains_to_the_processors_bits() {
    let Some(gpu) = Fixture::shared() else { return };
    for reassign in [
        ReassignPolicy::Off,
        ReassignPolicy::Padded,
        ReassignPolicy::Forwarded,
        ReassignPolicy::Dense,
    ] {
        let asked = PaperOverrides { reassign: Some(reassign), ..PaperOverrides::default() };
        let used = compared(&gpu, &asked, &frames(), |_| ());
        assert_eq!((counts(&used), &used.given_up), (ALL_OF_THEM, &None));
        assert!(used.open_share < 0.02, "{reassign:?}: {used:?}");
    }
    gpu.assert_no_faults();
}

#[test]
fn any_number_of_candidates_and_components_gives_the_processors_bits() {
    let Some(gpu) = Fixture::shared() else { return };
    for components in [1, 3, 64, 20_000] {
        for n in 1..=4 {
            for init in [Init::Random, Init::Data] {
                let asked = PaperOverrides {
                    components: Some(components),
                    candidates: Some(Candidates::Nearest(n)),
                    init: Some(init),
                    ..PaperOverrides::default()
                };
                let used = compared(&gpu, &asked, &frames()[..2], |_| ());
                assert_eq!((counts(&used), &used.given_up), ([1, 1], &None), "{asked:?}");
            }
        }
    }
    gpu.assert_no_faults();
}

/// Ties between equal components, duplicate points, and points on means, with and without the exponential.
#[test]
fn equal_components_share_as_on_the_processor() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut points = Points::new();
    for tile in 0..40 {
        for k in 0..64 {
            // Each point occurs three times, and points lie halfway between others.
            let at = ((tile * 64 + k) / 3) as f32 * 0.125;
            let position = [at % 2.0, (at / 2.0).floor() * 0.25, 0.5];
            points.push([position[0], position[1], position[2], 0.25, 0.25, 0.25]);
        }
        points.close_tile();
    }
    let asked = PaperOverrides {
        components: Some(900),
        init: Some(Init::Data),
        ..PaperOverrides::default()
    };
    let used = compared(&gpu, &asked, &[points.clone(), points.clone(), points], |_| ());
    assert_eq!((counts(&used), &used.given_up), ([2, 1], &None));
    gpu.assert_no_faults();
}

#[test]
fn points_that_are_no_numbers_or_far_away_are_the_processors() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut frames = frames();
    for (i, bad) in [f32::NAN, f32::INFINITY, -1e30, 7e4].into_iter().enumerate() {
        frames[2].x[1000 * i] = bad;
        frames[3].b[1000 * i] = bad;
    }
    frames[1].z[100] = 900.0;
    let used = compared(&gpu, &PaperOverrides::default(), &frames, |_| ());
    assert_eq!((counts(&used), &used.given_up), (ALL_OF_THEM, &None));
    assert!(used.open_share > 0.0 && used.open_share < 0.1, "{used:?}");
    let none = Points::new();
    let used = compared(&gpu, &PaperOverrides::default(), &[none.clone(), none], |_| ());
    assert_eq!((used.device_frames + used.processor_frames, used.given_up), (2, None));
    gpu.assert_no_faults();
}

#[test]
fn a_lost_device_costs_no_frame_and_no_bit() {
    let Some(gpu) = Fixture::own(|_| ()) else { return };
    let used = compared(&gpu, &PaperOverrides::default(), &frames(), |frame| {
        if frame == 2 {
            gpu.device.destroy();
        }
    });
    assert_eq!(counts(&used), [1, 3], "{used:?}");
    assert!(used.given_up.is_some_and(|why| !why.is_empty()));
}

#[test]
fn what_the_device_has_no_room_for_is_said() {
    let small = |limits: &mut wgpu::Limits| limits.max_storage_buffer_binding_size = 1 << 16;
    let Some(gpu) = Fixture::own(small) else { return };
    let frames = frames();
    let many = PaperOverrides { components: Some(5000), ..PaperOverrides::default() };
    let mut learner = begun(&many, &frames[0]);
    let refused = learner
        .add_device(TrainingDevice::Passes(Box::new(mixture(&gpu))), DevicePolicy::Device)
        .unwrap_err();
    let why = refused.to_string();
    assert!(why.contains("a buffer of 1 MiB is needed for means of components"), "{why}");
    assert_eq!(learner.device_use().passes.unwrap().device, None);
    // Few components, but a frame that is too large for the device: the CPU trains it.
    let few = PaperOverrides { components: Some(2000), ..PaperOverrides::default() };
    let used = compared(&gpu, &few, &frames, |_| ());
    assert_eq!(counts(&used), [0, FRAMES as u64]);
    assert!(used.given_up.is_some_and(|why| why.contains("points of a frame")));
}

/// Milliseconds per frame of the paper's size, on this device and on the CPU.
#[test]
#[ignore = "a measurement: run it alone, on the machine and GPU of interest"]
fn figures_of_a_frame_of_the_papers_size() {
    let Some(gpu) = Fixture::shared() else { return };
    // Software drivers need seconds per frame and their times are meaningless: only check that it runs.
    let (n_frames, side) = if gpu.is_software() { (2, 16) } else { (16, 58) };
    let frames: Vec<_> = (0..n_frames).map(|t| wavy_frame(0.05 * t as f32, side)).collect();
    println!("{} points, {} threads", frames[0].len(), rayon::current_num_threads());
    for reassign in [ReassignPolicy::Off, ReassignPolicy::Forwarded, ReassignPolicy::Padded] {
        for init in [Init::Random, Init::Data] {
            let asked = PaperOverrides {
                components: Some(100_000),
                reassign: Some(reassign),
                init: Some(init),
                ..PaperOverrides::default()
            };
            let [mut alone, mut beside] = [(); 2].map(|()| begun(&asked, &frames[0]));
            beside
                .add_device(TrainingDevice::Passes(Box::new(mixture(&gpu))), DevicePolicy::Device)
                .unwrap();
            let [on_processor, on_device] =
                [&mut alone, &mut beside].map(|learner| milliseconds(&mut **learner, &frames));
            assert!(beside.state() == alone.state(), "{asked:?}");
            let used = beside.device_use().passes.unwrap();
            println!(
                "{reassign:?} {init:?}: device {on_device}, processor {on_processor}, open tiles {:.4}",
                used.open_share
            );
            assert_eq!(used.given_up, None);
        }
    }
}

/// Medians over the second half of the frames: total, then by stage.
fn milliseconds(learner: &mut dyn PaperLearner, frames: &[Points<f32>]) -> String {
    let times: Vec<_> = frames.iter().map(|points| learner.learn(points).unwrap().ms).collect();
    let median = |of: &dyn Fn(&StageMs) -> f64| {
        let mut of_frames: Vec<f64> = times[times.len() / 2..].iter().map(of).collect();
        of_frames.sort_by(f64::total_cmp);
        of_frames[of_frames.len() / 2]
    };
    let stages = PAPER_STAGES.iter().enumerate();
    let stages =
        stages.map(|(i, stage)| format!("{} {:.2}", stage.key, median(&|ms| ms.values()[i])));
    format!("{:.2} ms ({})", median(&|ms| ms.train), stages.collect::<Vec<_>>().join(", "))
}
