//! Invariants: merging mixtures is commutative and associative, a scene conserves evidence, and the
//! position, rotation and unit of the world do not matter.

use super::budget::{H, checkpoint, frame};
use glam::{DMat4, DQuat, DVec3};
use proptest::array::uniform13;
use proptest::collection::vec;
use proptest::prelude::*;
use std::sync::OnceLock;
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
use vbgs_studio::export::checkpoint::{StoredModel, parse, to_bytes};
use vbgs_studio::model::paper::merging;
use vbgs_studio::model::paper::state::Totals;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

fn learnt(config: &SceneConfig, frames: &[Observation]) -> SceneTrainer {
    let mut scene = SceneTrainer::new(config, DVec3::ZERO);
    for frame in frames {
        scene.learn(frame).unwrap();
    }
    scene
}

/// Totals of three components in 64 bits with carries; `broad` makes them in 128 bits.
fn narrow() -> impl Strategy<Value = Totals> {
    let rows = vec(uniform13(any::<i64>()), 3);
    rows.prop_map(|rows| Totals::Fixed64 { rows, carries: Vec::new() })
}

fn broad() -> impl Strategy<Value = Totals> {
    vec(uniform13(any::<i128>().prop_map(|sum| sum / 4)), 3).prop_map(Totals::Fixed128)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 60, failure_persistence: None, ..ProptestConfig::default() })]

    /// Every point a frame reports as used counts in some component, merged or not, and every
    /// covariance is positive definite.
    #[test]
    fn evidence_is_conserved_and_covariances_are_definite(
        // Budgets below 6 also coarsen the scale.
        budget in prop_oneof![1..6usize, 6..100usize],
        frames in vec(frame(200), 1..4),
    ) {
        let config = SceneConfig { max_components: budget, ..SceneConfig::fine(H) };
        let mut scene = SceneTrainer::new(&config, DVec3::ZERO);
        let mut points = 0;
        for frame in &frames {
            points += scene.learn(frame).unwrap().points;
            let posteriors = || (0..scene.status().components).map(|k| scene.component(k).posterior);
            prop_assert_eq!(posteriors().map(|p| p.count).sum::<f64>(), points as f64);
            for posterior in posteriors().filter(|p| p.count > 0.0) {
                let least = posterior.expected_covariance().eigen().values.min_element();
                prop_assert!(least > 0.0, "{posterior:?}");
            }
        }
    }

    /// Mixtures in both exact forms, merged in any tree and order, including sums beyond 64 bits.
    #[test]
    fn merging_mixtures_is_commutative_and_associative(
        totals in prop_oneof![[narrow(), narrow(), narrow()], [broad(), broad(), broad()]],
    ) {
        let [a, b, c] = &totals;
        let ab = merging::add(a, b).unwrap();
        prop_assert!(ab == merging::add(b, a).unwrap());
        let whole = merging::add(&ab, c).unwrap();
        prop_assert!(whole == merging::add(a, &merging::add(b, c).unwrap()).unwrap());
        prop_assert!(whole == merging::add(&merging::add(c, a).unwrap(), b).unwrap());
    }

    /// A checkpoint read and written again gives the same bytes; a restored scene is stored and drawn like
    /// the saved one.
    #[test]
    fn checkpoints_of_what_was_read_are_the_same_files(
        budget in 1..200usize,
        frames in vec(frame(200), 1..4),
    ) {
        let config = SceneConfig { max_components: budget, ..SceneConfig::fine(H) };
        let scene = learnt(&config, &frames);
        let n = frames.len() as u64;
        let bytes = to_bytes(&checkpoint(&scene, n));
        let read = parse(&bytes).unwrap().checkpoint;
        prop_assert!(to_bytes(&read) == bytes);
        let StoredModel::Scene(state) = read.model else { panic!("expected a stored scene") };
        let again = SceneTrainer::restore(&config, state, n).unwrap();
        prop_assert!(to_bytes(&checkpoint(&again, n)) == bytes);
        prop_assert!(again.splats() == scene.splats());
    }
}

/// Similarity transform of the world.
#[derive(Clone, Copy, Debug)]
struct Similarity {
    scale: f64,
    turn: DQuat,
    shift: DVec3,
}

impl Similarity {
    const NONE: Self = Self { scale: 1.0, turn: DQuat::IDENTITY, shift: DVec3::ZERO };

    fn apply(&self, p: DVec3) -> DVec3 {
        self.turn * p * self.scale + self.shift
    }
}

fn room() -> &'static [Frame] {
    static ROOM: OnceLock<Vec<Frame>> = OnceLock::new();
    ROOM.get_or_init(|| {
        let params = SyntheticParams {
            width: 64,
            height: 48,
            n_train: 24,
            n_eval: 0,
            depth_noise: 1.0,
            ..SyntheticParams::demo()
        };
        let room = dataset(&params).unwrap();
        (0..4).map(|i| room.load(0, i).unwrap()).collect()
    })
}

/// Frame as captured in the transformed world.
fn seen_in(frame: &Frame, world: &Similarity) -> Frame {
    let pose = frame.camera.pose;
    let turn = world.turn * DQuat::from_mat3(&pose.rotation());
    let depth = frame.depth_z().unwrap();
    let lengths: Vec<f32> =
        depth.data.iter().map(|z| (f64::from(*z) * world.scale) as f32).collect();
    let [near, far] = frame.depth.as_ref().unwrap().trusted;
    let trusted = [near * world.scale, far * world.scale];
    let mut seen = Frame::from_memory(
        &frame.name,
        frame.camera.intrinsics,
        DMat4::from_rotation_translation(turn, world.apply(pose.centre())),
        ColorBuffer::Rgba8(frame.color.data.as_flattened()),
        Some(DepthBuffer { lengths: &lengths, kind: DepthKind::Z, trusted }),
    )
    .unwrap();
    seen.depth.as_mut().unwrap().units_per_metre = world.scale;
    seen
}

/// Statistics of a scene trained in a transformed world, mapped back to the original.
struct Said {
    used: f64,
    points: f64,
    /// From here on over the drawn splats, world units: mean and mean square of their positions, mean
    /// scale, mean opacity and mean colour.
    mean: DVec3,
    spread: f64,
    scale: f64,
    opacity: f64,
    color: DVec3,
}

fn said_in(world: &Similarity) -> Said {
    let config = SceneConfig {
        photometric: PhotometricMode::Light.rule(),
        ..SceneConfig::coarse(0.06 * world.scale)
    };
    let mut surface = SurfaceSettings::of_sensor(Sensor::Kinect, world.shift);
    surface.photograph = true;
    let mut scene = SceneTrainer::new(&config, surface.origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
    let mut points = 0;
    for frame in room() {
        preparer.prepare(&seen_in(frame, world), &surface, &mut seen).unwrap();
        points += scene.learn(&seen).unwrap().points;
    }
    let back = |p: DVec3| world.turn.inverse() * (p - world.shift) / world.scale;
    let (mut mean, mut spread, mut scale, mut opacity) = (DVec3::ZERO, 0.0, 0.0, 0.0);
    let (mut color, mut n) = (DVec3::ZERO, 0.0);
    let vector = |v: [f32; 3]| DVec3::from_array(v.map(f64::from));
    for splat in scene.splats().iter() {
        if splat.opacity > 0.0 {
            let at = back(vector(splat.mean));
            n += 1.0;
            mean += at;
            spread += at.length_squared();
            scale += f64::from(splat.scale.iter().sum::<f32>()) / world.scale;
            opacity += f64::from(splat.opacity);
            color += vector(splat.color);
        }
    }
    Said {
        used: scene.status().used as f64,
        points: points as f64,
        mean: mean / n,
        spread: spread / n,
        scale: scale / n,
        opacity: opacity / n,
        color: color / n,
    }
}

fn unit() -> impl Strategy<Value = DVec3> {
    [-1.0..1.0f64, -1.0..1.0, -1.0..1.0].prop_map(DVec3::from_array)
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 8, failure_persistence: None, ..ProptestConfig::default() })]
    #[test]
    fn the_world_may_be_told_otherwise(
        power in -4.0..4.0f64,
        turn in unit(),
        shift in unit(),
    ) {
        let scale = 10f64.powf(power);
        let turn = DQuat::from_scaled_axis(turn * 3.0);
        let world = Similarity { scale, turn, shift: shift * 100.0 * scale };
        let (here, there) = (said_in(&Similarity::NONE), said_in(&world));
        let ratio = |a: f64, b: f64| (b / a - 1.0).abs();
        prop_assert!(ratio(here.used, there.used) < 0.01, "{} {}", here.used, there.used);
        prop_assert!(ratio(here.points, there.points) < 0.001, "{} {}", here.points, there.points);
        prop_assert!(here.mean.distance(there.mean) < 0.01, "{} {}", here.mean, there.mean);
        prop_assert!(ratio(here.spread, there.spread) < 0.01, "{} {}", here.spread, there.spread);
        prop_assert!(ratio(here.scale, there.scale) < 0.01, "{} {}", here.scale, there.scale);
        prop_assert!(ratio(here.opacity, there.opacity) < 0.01, "{} {}", here.opacity, there.opacity);
        prop_assert!(here.color.distance(there.color) < 0.005, "{} {}", here.color, there.color);
    }
}
