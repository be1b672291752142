//! Budgets hold, whatever is seen: components in use of seeds, drawn ones of lattices. And whatever
//! they merged is read back.

use glam::DVec3;
use proptest::collection::vec;
use proptest::prelude::*;
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, parse, to_bytes};
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::train::scene::config::{BirthRule, SceneConfig};
use vbgs_studio::train::scene::engine;

/// Structural scale, world units.
pub const H: f64 = 0.05;

/// Points anywhere in a box of so many structural scales, on a wall along an axis of it or not.
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

pub fn births() -> impl Strategy<Value = BirthRule> {
    prop_oneof![Just(BirthRule::Seeds), Just(BirthRule::Lattice), Just(BirthRule::BodyCentred)]
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(150))]
    #[test]
    fn no_scene_exceeds_its_budget(
        births in births(),
        budget in 1..150usize,
        frames in vec(frame(250), 1..4),
    ) {
        let fine = SceneConfig::fine(H);
        let config = SceneConfig { births, max_components: budget, ..fine };
        let mut scene = engine::begin(&config, DVec3::ZERO);
        for (frame, n) in frames.iter().zip(1..) {
            let outcome = scene.learn(frame).unwrap();
            prop_assert!(births != BirthRule::Seeds || scene.used() <= budget, "{}", scene.used());
            prop_assert!(scene.used() <= 8 * budget);
            prop_assert!(outcome.points <= frame.points.len());
            let drawn = |splat: &&Splat| splat.opacity > 0.0;
            let n_drawn = scene.stored_splats().iter().filter(drawn).count();
            prop_assert!(n_drawn <= budget, "{n_drawn} drawn");
            let stored = Checkpoint {
                config: "{}".into(),
                meta: "{}".into(),
                numerics: "{}".into(),
                history: None,
                cursor: Cursor { frames: n, points: 1, visited: (0..n as u32).collect() },
                model: scene.stored(),
            };
            prop_assert_eq!(parse(&to_bytes(&stored)).unwrap().checkpoint, stored);
        }
    }
}
