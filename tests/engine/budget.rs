//! Component budgets hold for any frames.

use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, parse, to_bytes};
use vbgs_studio::model::attributes::StoredModel;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::outcome::{BirthLog, TrainingWarning};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

/// Structural scale, world units.
pub const H: f64 = 0.05;

/// Random points in a box of 1 to 30 structural scales, filling it or on an axis-aligned wall.
pub fn frame(most: usize) -> impl Strategy<Value = Observation> {
    let places = vec([0.0..1.0f32, 0.0..1.0, 0.0..1.0], 1..most);
    (places, 1.0..30.0f32, 0..4usize, 0.0..1.0f32).prop_map(|(places, extent, flat, wall)| {
        let point = |mut place: [f32; 3]| {
            if let Some(x) = place.get_mut(flat) {
                *x = wall;
            }
            SurfacePoint {
                position: place.map(|x| x * extent * H as f32),
                range: 1.0,
                color: place,
                normal: [0.0, 0.0, -1.0],
                direction: [0.0, 0.0, 1.0],
                ..SurfacePoint::default()
            }
        };
        Observation { points: places.into_iter().map(point).collect(), ..Observation::empty() }
    })
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn no_scene_exceeds_its_budget(
        budget in 1..150usize,
        frames in vec(frame(250), 1..4),
    ) {
        let config = SceneConfig { max_components: budget, ..SceneConfig::fine(H) };
        let mut scene = SceneTrainer::new(&config, DVec3::ZERO);
        let mut births = BirthLog::new(&scene);
        for (position, frame) in frames.iter().enumerate() {
            let outcome = scene.learn(frame).unwrap();
            births.record(&scene, position);
            // Rows that merging freed hold no points and are not born.
            for id in 0..scene.status().components {
                let is_used = scene.component(id).posterior.count > 0.0;
                prop_assert_eq!(births.first_frame_of(id).is_some(), is_used);
            }
            prop_assert!(scene.status().used <= budget, "{}", scene.status().used);
            // No point is lost: if merging frees too little, the scale coarsens.
            prop_assert!(outcome.points == frame.points.len());
            let drawn = |splat: &&Splat| splat.opacity > 0.0;
            let n_drawn = scene.splats().iter().filter(drawn).count();
            prop_assert!(n_drawn <= budget, "{n_drawn} drawn");
        }
    }

    /// The result depends neither on the number of threads nor on stops between frames.
    #[test]
    fn a_budget_far_too_small_widens_the_scale_alike_however_it_is_run(
        budget in 1..30usize,
        frames in vec(frame(250), 2..5),
        photometric in prop_oneof![Just(PhotometricMode::Off), Just(PhotometricMode::Light)],
    ) {
        let config = SceneConfig {
            max_components: budget,
            photometric: photometric.rule(),
            ..SceneConfig::coarse(H)
        };
        let whole = in_one(&config, &frames, 1);
        prop_assert!(whole == in_one(&config, &frames, 3));
        let mut scene = SceneTrainer::new(&config, DVec3::ZERO);
        for (frame, n) in frames.iter().zip(1..) {
            scene.learn(frame).unwrap();
            let bytes = to_bytes(&checkpoint(&scene, n));
            let StoredModel::Scene(state) = parse(&bytes).unwrap().checkpoint.model else {
                panic!("expected a stored scene")
            };
            scene = SceneTrainer::restore(&config, state, n).unwrap();
        }
        prop_assert!(whole == scene.checkpoint_model());
    }
}

pub fn checkpoint(scene: &SceneTrainer, n: u64) -> Checkpoint {
    Checkpoint {
        config: "{}".into(),
        meta: "{}".into(),
        numerics: "{}".into(),
        history: None,
        cursor: Cursor { frames: n, points: 1, visited: (0..n as u32).collect() },
        model: scene.checkpoint_model(),
    }
}

fn in_one(config: &SceneConfig, frames: &[Observation], n_threads: usize) -> StoredModel {
    let threads = rayon::ThreadPoolBuilder::new().num_threads(n_threads).build().unwrap();
    threads.install(|| {
        let mut scene = SceneTrainer::new(config, DVec3::ZERO);
        for frame in frames {
            scene.learn(frame).unwrap();
        }
        scene.checkpoint_model()
    })
}

/// Returns a strip of a floor of 100 × 100 structural scales, one of 40.
fn strip(i: i32) -> Observation {
    let point = |k: i32| SurfacePoint {
        position: [
            (k % 400) as f32 * 0.25 * H as f32,
            (10 * i + k / 400) as f32 * 0.25 * H as f32,
            1.0,
        ],
        range: 1.0,
        color: [0.5, (k % 7) as f32 / 7.0, 0.5],
        normal: [0.0, 0.0, -1.0],
        direction: [0.0, 0.0, 1.0],
        ..SurfacePoint::default()
    };
    Observation { points: (0..4000).map(point).collect(), ..Observation::empty() }
}

/// A twentieth of the components that a floor would use without a budget still covers it, whether the floor
/// comes as one strip per frame or as one frame.
#[test]
fn a_twentieth_of_the_budget_covers_everything_by_coarser_components() {
    let strips: Vec<_> = (0..40).map(strip).collect();
    let points = strips.iter().flat_map(|strip| strip.points.clone()).collect();
    let floor = [Observation { points, ..Observation::empty() }];
    for frames in [&strips[..], &floor] {
        let learn = |budget: usize| {
            let config = SceneConfig { max_components: budget, ..SceneConfig::fine(H) };
            let mut scene = SceneTrainer::new(&config, DVec3::ZERO);
            for frame in frames {
                assert_eq!(scene.learn(frame).unwrap().points, frame.points.len());
            }
            scene
        };
        let asked = learn(1_000_000);
        assert_eq!(asked.status().warnings, []);
        let few = learn(asked.status().used / 20);
        assert!(
            few.status().used <= asked.status().used / 20
                && few.status().used > asked.status().used / 50,
            "{}",
            few.status().used
        );
        let warnings = few.status().warnings;
        let [TrainingWarning::Coarsened { requested: h, scale }] = warnings[..] else {
            panic!("{warnings:?}")
        };
        assert!(h == H && (2.0 * H..8.0 * H).contains(&scale), "{scale}");
        let all = learn(asked.status().used);
        assert!(
            all.checkpoint_model() == asked.checkpoint_model(),
            "a budget that is not reached changed the scene"
        );
    }
}
