//! Training of the scene preset with arbitrary settings and commands.

use super::{MAX_COMMANDS, frame, read_back};
use crate::entries::bytes::Bytes;
use glam::DVec3;
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::export::checkpoint::StoredModel;
use vbgs_studio::model::scene::state::{MAX_COARSENING_STEPS, SceneState};
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::learner::{Learner, Learns};
use vbgs_studio::train::scene::config::SceneConfig;
use vbgs_studio::train::scene::fusion::fuse;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::trainer::SceneTrainer;

/// Reads settings, then executes commands until the bytes end. Returns the number of steps by which the scale
/// has been coarsened.
pub fn train(kind: u8, mut input: Bytes) -> u32 {
    let Ok(config) = config(kind, &mut input).check() else { return 0 };
    let sensor = [Sensor::Inverse8Ray, Sensor::Kinect, Sensor::Lidar, Sensor::Exact { noise: 0.0 }]
        [usize::from(input.byte() % 4)];
    let origin = DVec3::splat(f64::from(input.number()).clamp(-1e7, 1e7));
    if origin.is_nan() {
        return 0;
    }
    let mut surface = SurfaceSettings::of_sensor(sensor, origin);
    surface.photograph = config.photometric.is_some();
    let mut scene = SceneTrainer::new(&config, origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
    let (mut earlier, mut is_fused) = (state(&scene), false);
    for _ in 0..MAX_COMMANDS {
        if input.is_empty() {
            break;
        }
        match input.byte() % 8 {
            0..=2 => {
                let Some(frame) = frame(&mut input) else { continue };
                let usable = preparer.prepare(&frame, &surface, &mut seen).is_ok();
                if !usable || scene.learn(&seen).is_err() {
                    seen = Observation::empty();
                }
            }
            3 => drop(scene.learn(&seen)),
            // Later training must not depend on this call.
            4 if input.flag() => drop(scene.settle()),
            4 => drop(scene.revisit_photograph(&seen)),
            5 => {
                scene = reopened(&config, &scene);
                earlier = state(&scene);
            }
            6 => {
                scene = fused(&config, &scene, &earlier);
                is_fused = true;
            }
            _ => match input.flag() {
                true => scene.component_elbo_mut().start(),
                false => scene.component_elbo_mut().stop(),
            },
        }
        check(&config, &scene, is_fused);
    }
    state(&scene).coarsening_steps
}

fn state(scene: &SceneTrainer) -> SceneState {
    let StoredModel::Scene(state) = scene.checkpoint_model() else {
        panic!("a scene is stored as one")
    };
    state
}

fn config(kind: u8, input: &mut Bytes) -> SceneConfig {
    let h = f64::from(input.number());
    let mut config = match kind % 3 {
        0 => SceneConfig::fine(h),
        1 => SceneConfig::exact(h),
        _ => SceneConfig::coarse(h),
    };
    let flags = input.byte();
    config.refine = flags & 1 != 0;
    config.align = flags & 2 != 0;
    config.gain = flags & 4 != 0;
    config.track = flags & 8 != 0;
    config.photometric = match flags >> 6 {
        2 => PhotometricMode::Light.rule(),
        3 => PhotometricMode::Full.rule(),
        _ => None,
    };
    if let Some(rule) = &mut config.photometric {
        rule.shuffle_buffer = usize::from(flags & 3);
    }
    config.max_components = 1 + usize::from(input.byte());
    config
}

/// Restores the scene from its own checkpoint.
fn reopened(config: &SceneConfig, scene: &SceneTrainer) -> SceneTrainer {
    let state = read_back(scene.checkpoint_model(), scene.status().frames);
    let StoredModel::Scene(state) = state else { panic!("a scene is stored as one") };
    let restored =
        SceneTrainer::restore(config, state, scene.status().frames).expect("seeds within reach");
    assert!(restored.checkpoint_model() == scene.checkpoint_model(), "another scene comes back");
    restored
}

/// Fuses the scene with an earlier state of itself, perhaps at a finer scale.
fn fused(config: &SceneConfig, scene: &SceneTrainer, earlier: &SceneState) -> SceneTrainer {
    let now = state(scene);
    let Some(fused) = fuse(config, None, &[&now, earlier]) else {
        return reopened(config, scene);
    };
    let StoredModel::Scene(fused) = read_back(StoredModel::Scene(fused), 2 * scene.status().frames)
    else {
        panic!("a scene is stored as one")
    };
    SceneTrainer::restore(config, fused, 2 * scene.status().frames).expect("seeds within reach")
}

/// Checks the invariants of a model.
fn check(config: &SceneConfig, scene: &SceneTrainer, is_fused: bool) {
    let stored = scene.splats();
    let drawn = stored.iter().filter(|splat| splat.opacity > 0.0);
    let n_drawn = drawn.inspect(|splat| assert!(splat.is_valid(), "{splat:?}")).count();
    // At the largest scale a fused scene stays above the budget, since no point is dropped.
    if !is_fused || state(scene).coarsening_steps < MAX_COARSENING_STEPS {
        assert!(n_drawn <= config.max_components, "{n_drawn} of {}", config.max_components);
        assert!(scene.status().used <= config.max_components, "{} used", scene.status().used);
    }
    for component in 0..scene.status().components {
        let posterior = scene.component(component).posterior;
        assert!(posterior.count >= 0.0, "{}", posterior.count);
    }
}
