//! The search along rays keeps noise along the viewing direction from adding a second layer to a surface.

use super::budget::H;
use glam::DVec3;
use vbgs_studio::observation::surface::{Observation, SurfacePoint};
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::trainer::SceneTrainer;

/// Half-width of the wall's depth noise, world units.
const NOISE: f64 = 0.5 * H;

/// Wall whose depths err by up to three half-widths of noise. Most of the error is common to a frame, as
/// with a depth camera.
fn noisy_wall(frame: i32) -> Observation {
    let point = |i: i32| {
        // Uniform in [-1, 1], without a pattern across neighbours.
        let even = |n: i32| f64::from(n % 1001) / 500.0 - 1.0;
        let error = 2.5 * even(500 + frame * 377) + 0.5 * even(i * 7919 + frame * 104_729);
        let (x, y) = (f64::from(i % 60) * 0.2 * H, f64::from(i / 60) * 0.2 * H);
        let z = 100.0 * H + NOISE * error;
        SurfacePoint {
            position: [x as f32, y as f32, z as f32],
            range: z as f32,
            noise: NOISE as f32,
            normal: [0.0, 0.0, -1.0],
            direction: [0.0, 0.0, 1.0],
            ..SurfacePoint::default()
        }
    };
    Observation { points: (0..3600).map(point).collect(), ..Observation::empty() }
}

/// Used components after eight frames of the wall, and the RMS distance of their splats from it.
fn learnt(ray_search: f64) -> (usize, f64) {
    let config = SceneConfig { ray_search, ..SceneConfig::fine(H) };
    let mut scene = SceneTrainer::new(&config, DVec3::ZERO);
    for frame in 0..8 {
        assert_eq!(scene.learn(&noisy_wall(frame)).unwrap().points, 3600, "no point is lost");
    }
    let splats = scene.splats().into_splats();
    let errors: Vec<f64> =
        splats.iter().map(|splat| f64::from(splat.mean[2]) - 100.0 * H).collect();
    let squares: f64 = errors.iter().map(|error| error * error).sum();
    (scene.status().used, (squares / errors.len() as f64).sqrt())
}

#[test]
fn a_noisy_wall_is_one_layer() {
    let (without, spread_without) = learnt(0.0);
    let (used, spread) = learnt(4.0);
    println!("{without} components within {spread_without:.4}, {used} within {spread:.4}");
    assert!(used * 3 < without * 2, "{without} -> {used} components");
    assert!(spread < 0.6 * spread_without, "{spread_without} -> {spread}");
}
