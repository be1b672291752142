//! Near views get smaller components, whatever came before; a restored scene continues bit for bit.

use super::budget::{H, frame};
use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, parse, to_bytes};
use vbgs_studio::model::attributes::StoredModel;
use vbgs_studio::model::scene::state::SceneState;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::train::scene::config::{BirthRule, SceneConfig, VisibilityRule};
use vbgs_studio::train::scene::engine;
use vbgs_studio::train::scene::engine::SceneLearner;
use vbgs_studio::train::scene::spacing::NearSpacing;

fn config() -> SceneConfig {
    SceneConfig { near: Some(NearSpacing { pixels: 10.0, least: 0.25 }), ..SceneConfig::fine(H) }
}

/// Wall whose points have the given pixel footprint, world units.
fn wall(footprint: f64) -> Observation {
    let point = |i: i32| SurfacePoint {
        position: [(i % 60) as f32 * 0.01, (i / 60) as f32 * 0.01, 1.0],
        range: 1.0,
        normal: [0.0, 0.0, -1.0],
        direction: [0.0, 0.0, 1.0],
        footprint: footprint as f32,
        ..SurfacePoint::default()
    };
    Observation { points: (0..3600).map(point).collect(), ..Observation::empty() }
}

fn state(scene: &dyn SceneLearner) -> SceneState {
    match scene.checkpoint_model() {
        StoredModel::Scene(state) => state,
        StoredModel::Mixture { .. } => unreachable!("a scene is trained"),
    }
}

#[test]
fn a_nearer_view_is_told_apart_and_a_farther_one_changes_nothing() {
    let mut scene = engine::begin(&config(), DVec3::ZERO);
    let mut even = engine::begin(&SceneConfig::fine(H), DVec3::ZERO);
    let mut learn = |footprint: f64| {
        assert_eq!(scene.learn(&wall(footprint)).unwrap().points, 3600);
        even.learn(&wall(footprint)).unwrap();
        [scene.used(), even.used()]
    };
    let [far, whole] = learn(0.1 * H);
    assert_eq!(far, whole, "ten pixels of 0.1 h span the structural scale");
    let [near, whole] = learn(0.05 * H);
    assert!(near > 2 * far, "half the spacing: {far} -> {near}");
    assert_eq!(learn(H), [near, whole]);
    let [nearest, _] = learn(0.0);
    assert!(nearest > 2 * near, "{near} -> {nearest}");
    let [again, whole] = learn(0.0);
    assert_eq!((again, whole), (nearest, far), "at least a quarter of h");
    let shares = state(scene.as_ref()).shares.unwrap();
    assert_eq!(shares.iter().filter(|&&share| share == 64).count(), far);
    assert_eq!(shares.iter().filter(|&&share| share == 16).count(), nearest - near);
    assert_eq!(state(even.as_ref()).shares, None);
}

#[test]
fn opacity_does_not_depend_on_how_small_components_are() {
    // One point per pixel: every return that a closed surface gives.
    let opacity = |near: Option<NearSpacing>| {
        let visibility = VisibilityRule::Returned;
        let config = SceneConfig { near, visibility, ..SceneConfig::fine(H) };
        let mut scene = engine::begin(&config, DVec3::ZERO);
        for _ in 0..12 {
            scene.learn(&wall(0.01)).unwrap();
        }
        let drawn: Vec<f32> = scene.stored_splats().iter().map(|splat| splat.opacity).collect();
        (drawn.iter().sum::<f32>() / drawn.len() as f32, drawn.len())
    };
    let [even, near] = [None, Some(NearSpacing { pixels: 1.0, least: 0.4 })].map(opacity);
    assert!(near.1 > 4 * even.1, "{even:?} {near:?}");
    assert!((near.0 / even.0 - 1.0).abs() < 0.2, "{even:?} {near:?}");
}

#[test]
fn lattices_refuse_it() {
    let error = SceneConfig { births: BirthRule::Lattice, ..config() }.check().unwrap_err();
    assert_eq!((error.setting, error.found.as_str()), ("near_detail", "on"));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(100))]
    #[test]
    fn a_restored_scene_goes_on_to_the_same_bits_within_the_budget(
        budget in 5..150usize,
        least in 0.1..1.0f64,
        frames in vec((frame(250), 0.0..0.2f32), 2..5),
    ) {
        let near = Some(NearSpacing { pixels: 10.0, least });
        let config = SceneConfig { near, max_components: budget, ..SceneConfig::fine(H) };
        let mut scene = engine::begin(&config, DVec3::ZERO);
        for (n, (frame, footprint)) in frames.iter().enumerate() {
            let mut frame = frame.clone();
            for (i, point) in frame.points.iter_mut().enumerate() {
                point.footprint = footprint * H as f32 * (i % 5) as f32;
            }
            let stored = Checkpoint {
                config: "{}".into(),
                meta: "{}".into(),
                numerics: "{}".into(),
                history: None,
                cursor: Cursor { frames: n as u64, points: 1, visited: (0..n as u32).collect() },
                model: scene.checkpoint_model(),
            };
            let read = parse(&to_bytes(&stored)).unwrap().checkpoint;
            prop_assert_eq!(&read, &stored);
            let again = state(scene.as_ref());
            let mut again = engine::restore(&config, again, n as u64).unwrap();
            scene.learn(&frame).unwrap();
            again.learn(&frame).unwrap();
            prop_assert_eq!(state(scene.as_ref()), state(again.as_ref()));
            prop_assert!(scene.used() <= budget);
        }
    }
}
