//! Fitting the points of a scene on a GPU gives the CPU's bits, for any input and after a device failure.

use super::fixture::Fixture;
use glam::DVec3;
use std::sync::Arc;
use vbgs_studio::dataset::Dataset;
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::model::scene::points_device::{
    LEFT_TO_PROCESSOR, NO_SEED, PointsDevice, Seeds, SlotSums,
};
use vbgs_studio::model::scene::sums::{MAX_OFFSET, N_SUMS, terms};
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::pipeline::plan::Selection;
use vbgs_studio::pipeline::session::{Session, Step};
use vbgs_studio::pipeline::settings::scene::SceneOverrides;
use vbgs_studio::render::gpu::points::GpuPoints;
use vbgs_studio::train::device_trial::DevicePolicy;
use vbgs_studio::train::device_trial::PassUse;
use vbgs_studio::train::learner::{Learner, Learns, TrainingDevice};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

/// Structural scale of the synthetic frames, world units.
const H: f64 = 0.05;
const FRAMES: usize = 5;

fn points(fixture: &Fixture) -> GpuPoints {
    GpuPoints::new(fixture.headless())
}

fn counts(used: &PassUse) -> [u64; 2] {
    [used.device_frames, used.processor_frames]
}

/// Frames of the device and of the CPU: both compute the first frame, and the CPU's result is used.
const ALL_OF_THEM: [u64; 2] = [FRAMES as u64 - 1, 1];

/// A wavy wall with an edge, seen from a position that moves with `t`.
fn wall(t: usize) -> Observation {
    let mut rng = Rng::new(7, Purpose::Synthetic, t as u64);
    let phase = 0.4 * t as f32;
    let point = |i: usize| {
        let [tile, k] = [i / 64, i % 64];
        let [x, y] = [(tile % 9) * 8 + k % 8, (tile / 9) * 8 + k / 8].map(|n| n as f32);
        let [x, y] = [0.014 * x + 0.1 * phase, 0.014 * y];
        let edge = if x + 0.3 * y > 0.6 { 0.4 } else { 0.0 };
        let z = 1.5 + 0.1 * (5.0 * x).sin() * (4.0 * y).cos() + edge + 0.003 * rng.normal() as f32;
        let (normal, ray) = (DVec3::new(0.3, 0.1, -1.0), DVec3::new(x.into(), y.into(), z.into()));
        SurfacePoint {
            position: [x, y, z],
            range: ray.length() as f32,
            color: [x, y, z].map(|v| 0.5 + 0.5 * (9.0 * v).sin()),
            normal: normal.normalize().as_vec3().to_array(),
            direction: ray.normalize().as_vec3().to_array(),
            footprint: (0.002 + 0.004 * ((i / 640) % 3) as f64) as f32,
            ..SurfacePoint::default()
        }
    };
    Observation { points: (0..63 * 64 - 11).map(point).collect(), ..Observation::empty() }
}

fn walls() -> Vec<Observation> {
    (0..FRAMES).map(wall).collect()
}

/// Trains on the GPU and on the CPU and compares after every frame. `before` runs before each frame
/// and may break the device.
fn compared(
    gpu: &Fixture,
    config: &SceneConfig,
    frames: &[Observation],
    before: impl Fn(usize),
) -> PassUse {
    let [mut alone, mut beside] = [(); 2].map(|()| SceneTrainer::new(config, DVec3::ZERO));
    beside.add_device(TrainingDevice::Points(Box::new(points(gpu))), DevicePolicy::Device).unwrap();
    for (i, frame) in frames.iter().enumerate() {
        before(i);
        let expected = alone.learn(frame).unwrap();
        let found = beside.learn(frame).unwrap();
        assert_eq!(
            (found.points, found.new_components, found.merged, found.elbo_mean.to_bits()),
            (
                expected.points,
                expected.new_components,
                expected.merged,
                expected.elbo_mean.to_bits()
            ),
            "frame {i}"
        );
        assert!(beside.checkpoint_model() == alone.checkpoint_model(), "statistics of frame {i}");
        assert_eq!(beside.last_frame().changed, alone.last_frame().changed, "frame {i}");
    }
    beside.device_use().points.unwrap()
}

#[test]
fn frames_of_every_kind_are_learnt_to_the_processors_bits() {
    let Some(gpu) = Fixture::shared() else { return };
    let room = SceneConfig { gain: true, ..SceneConfig::fine(H) };
    for config in [SceneConfig::fine(H), room.clone(), SceneConfig { refine: false, ..room }] {
        for weight in [1, 4] {
            let weighted = |frame| Observation { point_weight: weight, ..frame };
            let frames: Vec<_> = walls().into_iter().map(weighted).collect();
            let used = compared(&gpu, &config, &frames, |_| ());
            assert_eq!((counts(&used), &used.given_up), (ALL_OF_THEM, &None));
            assert_eq!(used.open_share, 0.0);
        }
    }
    gpu.assert_no_faults();
}

#[test]
fn merging_and_a_wider_scale_in_the_middle_of_a_frame_change_no_bit() {
    let Some(gpu) = Fixture::shared() else { return };
    for max_components in [450, 40] {
        let config = SceneConfig { max_components, ..SceneConfig::fine(H) };
        let used = compared(&gpu, &config, &walls(), |_| ());
        assert_eq!((counts(&used), &used.given_up), (ALL_OF_THEM, &None));
    }
    gpu.assert_no_faults();
}

#[test]
fn what_only_the_processor_can_sum_is_left_to_it() {
    let Some(gpu) = Fixture::shared() else { return };
    let mut frames = walls();
    // Values that are not finite or out of range, and positions outside the grid.
    for (i, bad) in [f32::NAN, f32::INFINITY, -1e30, 5.0].into_iter().enumerate() {
        frames[2].points[500 * i].normal[1] = bad;
        frames[3].points[500 * i].color[2] = bad;
        frames[4].points[500 * i].direction[0] = bad;
        if bad.abs() != 5.0 {
            frames[4].points[500 * i + 3].position[2] = bad;
        }
    }
    // A wall close to the camera: one component gets more points than a row holds.
    let first = frames[1].points[0].position;
    frames[1].points.iter_mut().for_each(|point| point.position = first);
    frames[1].point_weight = 4;
    let used = compared(&gpu, &SceneConfig::fine(H), &frames, |_| ());
    assert_eq!((counts(&used), &used.given_up), (ALL_OF_THEM, &None));
    assert!(used.open_share > 0.0 && used.open_share < 0.5, "{used:?}");
    let none = [Observation::empty(), Observation::empty(), wall(0), Observation::empty()];
    let used = compared(&gpu, &SceneConfig::fine(H), &none, |_| ());
    assert_eq!((used.device_frames + used.processor_frames, used.given_up), (4, None));
    gpu.assert_no_faults();
}

#[test]
fn a_lost_device_costs_no_frame_and_no_bit() {
    let Some(gpu) = Fixture::own(|_| ()) else { return };
    let used = compared(&gpu, &SceneConfig::fine(H), &walls(), |frame| {
        if frame == 2 {
            gpu.device.destroy();
        }
    });
    assert_eq!(counts(&used), [1, 4], "{used:?}");
    assert!(used.given_up.is_some_and(|why| !why.is_empty()));
}

#[test]
fn what_the_device_has_no_room_for_is_said() {
    let small = |limits: &mut wgpu::Limits| limits.max_storage_buffer_binding_size = 1 << 17;
    let Some(gpu) = Fixture::own(small) else { return };
    let used = compared(&gpu, &SceneConfig::fine(H), &walls(), |_| ());
    assert_eq!(counts(&used), [0, FRAMES as u64]);
    let why = used.given_up.unwrap();
    assert!(why.contains("a buffer of 1 MiB is needed for points of a frame"), "{why}");
}

/// Random positions near the origin.
fn places(n: usize, stream: u64) -> Vec<[f32; 3]> {
    let mut rng = Rng::new(2, Purpose::Init, stream);
    (0..n).map(|_| [0; 3].map(|_| rng.range(-1.0, 1.0) as f32)).collect()
}

fn at(position: [f32; 3]) -> SurfacePoint {
    SurfacePoint { position, ..SurfacePoint::default() }
}

fn seeds(positions: &[[f32; 3]], are_new: bool) -> Seeds<'_> {
    let (h, max_cells) = (0.1, 1024.0);
    Seeds { h, per_cell: 1.0 / h, max_cells, positions, are_new }
}

fn nearest(gpu: &mut GpuPoints, points: &[SurfacePoint]) -> Vec<u32> {
    gpu.set_points(bytemuck::cast_slice(points)).unwrap();
    gpu.nearest().unwrap().to_vec()
}

/// Nearest seed by a search of all seeds.
fn expected(seeds: &[[f32; 3]], [x, y, z]: [f32; 3]) -> u32 {
    let distance2 = |s: &[f32; 3]| {
        let d = [x - s[0], y - s[1], z - s[2]];
        d[0] * d[0] + d[1] * d[1] + d[2] * d[2]
    };
    let near = seeds.iter().map(distance2).zip(0..).filter(|(d2, _)| *d2 <= 0.1f32 * 0.1);
    near.min_by(|a, b| a.partial_cmp(b).unwrap()).map_or(NO_SEED, |(_, id)| id)
}

#[test]
fn seeds_are_found_as_a_search_of_all_of_them_finds_them() {
    let Some(fixture) = Fixture::shared() else { return };
    let mut gpu = points(&fixture);
    let mut filed = places(9000, 0);
    // Two seeds at one position, seeds exactly one scale from a point, and seeds at the rim of the grid.
    filed.extend([filed[17], [3.0, 0.0, 0.0], [3.2, 0.0, 0.0], [102.35, -102.35, 0.0]]);
    let mut looked_for: Vec<_> = places(3000, 1).into_iter().map(at).collect();
    looked_for.extend(filed[..40].iter().copied().map(at));
    let corners =
        [[3.1, 0.0, 0.0], [102.39, -102.39, 0.0], [102.41, -102.3, 0.0], [0.0, 1e30, 0.0]];
    looked_for.extend(corners.map(at));
    // The hash table of seeds grows with their number and is rebuilt.
    for n in [0, 1000, 1001, 5000, filed.len()] {
        gpu.set_seeds(&seeds(&filed[..n], false)).unwrap();
        let found = nearest(&mut gpu, &looked_for);
        for (point, found) in looked_for.iter().zip(found) {
            let is_beyond = point.position.iter().any(|x| (x / 0.1).abs() >= 1024.0);
            let expected = if is_beyond { NO_SEED } else { expected(&filed[..n], point.position) };
            assert_eq!(found, expected, "{point:?} of {n}");
        }
    }
    // Replaces all seeds by a crowded cell, which the device leaves to the CPU.
    let crowd = vec![[0.05; 3]; 20_000];
    gpu.set_seeds(&seeds(&crowd, true)).unwrap();
    let found = nearest(&mut gpu, &[at([0.0; 3]), at([0.9; 3]), at([f32::NAN; 3])]);
    assert_eq!(found, [LEFT_TO_PROCESSOR, NO_SEED, NO_SEED]);
    fixture.assert_no_faults();
}

#[test]
fn sums_are_those_of_terms_in_whole_quanta() {
    let Some(fixture) = Fixture::shared() else { return };
    let mut gpu = points(&fixture);
    let mut rng = Rng::new(5, Purpose::Synthetic, 0);
    let mut vector = |lo: f64, hi: f64| [0; 3].map(|_| rng.range(lo, hi) as f32);
    let summed: Vec<SurfacePoint> = (0..3001)
        .map(|_| SurfacePoint {
            // Some lie beyond the clamp on offsets from the seed.
            position: vector(-0.4, 0.4),
            color: vector(0.0, 1.0),
            normal: vector(-1.0, 1.0),
            direction: vector(-1.0, 1.0),
            ..SurfacePoint::default()
        })
        .collect();
    let references: Vec<[f32; 4]> =
        (0..7).map(|_| vector(-0.2, 0.2)).map(|[x, y, z]| [x, y, z, 0.0]).collect();
    let shifts: Vec<f32> = (0..summed.len()).map(|_| vector(-0.01, 0.01)[0]).collect();
    // Runs of equal slots, single ones, and points without a seed.
    let slot = |i: usize| if i % 11 == 3 { NO_SEED } else { (i / 5 % 8).min(i % 7) as u32 };
    let fits: Vec<[u32; 2]> = (0..).zip(&shifts).map(|(i, s)| [slot(i), s.to_bits()]).collect();
    let (gain, per_h, weight) = ([1.2f32, 0.7, 1.0], 10.5f32, 4.0f32);
    let mut expected = vec![[0i32; N_SUMS]; references.len()];
    for (point, &[slot, shift]) in summed.iter().zip(&fits) {
        let Some(seed) = references.get(slot as usize) else { continue };
        let shift = f32::from_bits(shift);
        let offset = [0, 1, 2].map(|k| {
            let offset = point.position[k] - seed[k] + shift * point.direction[k];
            (offset * per_h).clamp(-MAX_OFFSET, MAX_OFFSET)
        });
        let color = [0, 1, 2].map(|k| (point.color[k] * gain[k]).min(1.0));
        let terms: [f32; N_SUMS] = terms(offset, color, point.normal, point.direction);
        for (sum, term) in expected[slot as usize].iter_mut().zip(terms) {
            *sum += (weight * term * 32768.0).round_ties_even() as i32;
        }
    }
    gpu.set_points(bytemuck::cast_slice(&summed)).unwrap();
    let asked = SlotSums { points: &fits, seeds: &references, per_h, gain, weight };
    assert!(gpu.sums(&asked).unwrap() == expected);
    // A point count of another frame is refused; an empty list gives no sums.
    assert!(gpu.sums(&SlotSums { points: &fits[1..], ..asked }).is_err());
    let nothing = SlotSums { points: &[], seeds: &[], ..asked };
    assert_eq!(gpu.sums(&nothing).unwrap().len(), 0);
    fixture.assert_no_faults();
}

fn room() -> Arc<Dataset> {
    let params = SyntheticParams {
        width: 80,
        height: 60,
        n_train: 10,
        n_eval: 0,
        seed: 9,
        depth_noise: 0.0,
        ..SyntheticParams::demo()
    };
    Arc::new(dataset(&params).unwrap())
}

#[test]
fn a_session_trains_to_the_processors_bits() {
    let Some(gpu) = Fixture::shared() else { return };
    let room = room();
    for photometric in [PhotometricMode::Off, PhotometricMode::Light] {
        let trained = |is_on_device: bool| {
            let photometric = Some(photometric);
            let asked = SceneOverrides { photometric, ..SceneOverrides::default() };
            let mut session = Session::new(room.clone(), asked, Selection::all_frames()).unwrap();
            if is_on_device {
                session
                    .add_device(
                        TrainingDevice::Points(Box::new(points(&gpu))),
                        DevicePolicy::Device,
                    )
                    .unwrap();
            }
            while !matches!(session.step().unwrap(), Step::Finished) {}
            session
        };
        let [alone, beside] = [false, true].map(trained);
        // Outlier frames of the photometric check are not summed.
        let [_, summed] = counts(&alone.learner().device_use().points.unwrap());
        assert_eq!(counts(&beside.learner().device_use().points.unwrap()), [summed - 1, 1]);
        assert!(summed > 5);
        assert!(beside.learner().checkpoint_model() == alone.learner().checkpoint_model());
    }
    gpu.assert_no_faults();
}
