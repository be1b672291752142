//! The trainer as a robot's program drives it: any frames, any settings, any order of calls.

use super::bytes::Bytes;
use glam::{DMat4, DQuat, DVec3};
use vbgs_studio::dataset::frame::{ColorBuffer, DepthBuffer, DepthKind, Frame};
use vbgs_studio::dataset::surface::{Preparer, Sensor, SurfaceSettings};
use vbgs_studio::export::checkpoint::{Checkpoint, Cursor, StoredModel, parse, to_bytes};
use vbgs_studio::math::camera::Intrinsics;
use vbgs_studio::observation::surface::Observation;
use vbgs_studio::train::scene::config::{BirthRule, SceneConfig, VisibilityRule};
use vbgs_studio::train::scene::engine;
use vbgs_studio::train::scene::learner::SceneLearner;
use vbgs_studio::train::scene::photometric::rule::PhotometricMode;
use vbgs_studio::train::scene::sum_form::SumForm;

const MAX_COMMANDS: usize = 24;

/// Settings, then commands until the bytes end.
pub fn training(data: &[u8]) {
    let mut input = Bytes(data);
    let Ok(config) = config(&mut input).check() else { return };
    let sensor = [Sensor::Inverse8Ray, Sensor::Kinect, Sensor::Lidar, Sensor::Exact { noise: 0.0 }]
        [usize::from(input.byte() % 4)];
    let origin = DVec3::splat(f64::from(input.number()).clamp(-1e7, 1e7));
    if origin.is_nan() {
        return;
    }
    let mut surface = SurfaceSettings::of_sensor(sensor, origin);
    surface.photograph = config.photometric.is_some();
    let mut scene = engine::begin(&config, origin);
    let (mut preparer, mut seen) = (Preparer::new(), Observation::empty());
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
            4 => drop(scene.look_again(&seen)),
            5 => scene = reopened(&config, &*scene),
            // Lattices are added, never fused.
            6 if !config.births.is_order_invariant() => scene = fused(&config, &*scene),
            6 => {}
            _ => match input.flag() {
                true => scene.component_elbo_mut().start(),
                false => scene.component_elbo_mut().stop(),
            },
        }
        check(&config, &*scene);
    }
}

fn config(input: &mut Bytes) -> SceneConfig {
    let kind = input.byte();
    let h = f64::from(input.number());
    let mut config = match kind % 3 {
        0 => SceneConfig::fine(h),
        1 => SceneConfig::exact(h),
        _ => SceneConfig::coarse(h),
    };
    config.births = [BirthRule::Seeds, BirthRule::Lattice, BirthRule::BodyCentred]
        [usize::from(input.byte() % 3)];
    config.sums = [SumForm::Mixed, SumForm::F32, SumForm::F64][usize::from(input.byte() % 3)];
    let flags = input.byte();
    // As files of settings have it: a lattice is neither moved nor corrected by what was seen.
    let moves = !config.births.is_order_invariant();
    config.refine = moves && flags & 1 != 0;
    config.align = moves && flags & 2 != 0;
    config.gain = moves && flags & 4 != 0;
    config.track = moves && flags & 8 != 0;
    config.visibility = match moves && flags & 16 != 0 {
        true => VisibilityRule::Projected,
        false => VisibilityRule::Returned,
    };
    config.photometric = match (moves, flags >> 6) {
        (true, 2) => PhotometricMode::Light.rule(),
        (true, 3) => PhotometricMode::Full.rule(),
        _ => None,
    };
    config.max_components = 1 + usize::from(input.byte());
    config
}

/// A frame as a driver delivers it; `None` for what is refused.
fn frame(input: &mut Bytes) -> Option<Frame> {
    let [width, height] = [1 + u32::from(input.byte() % 16), 1 + u32::from(input.byte() % 12)];
    let n = (width * height) as usize;
    let mut intrinsics = Intrinsics::from_horizontal_fov(width, height, 1.0);
    if input.flag() {
        intrinsics.fx = input.number().into();
        intrinsics.cy = input.number().into();
    }
    let turn = DVec3::new(input.number().into(), input.number().into(), 0.0);
    let place = DVec3::new(input.number().into(), 0.0, input.number().into());
    let pose = DMat4::from_rotation_translation(DQuat::from_scaled_axis(turn), place);
    let lengths: Vec<f32> = match input.byte() % 3 {
        // A plane, with whatever lies before it.
        0 => {
            let (length, slope, odd) = (input.number(), input.number(), input.number());
            let at = usize::from(input.byte());
            let plane = (0..n).map(|i| length + slope * (i % width as usize) as f32 / 64.0);
            plane.enumerate().map(|(i, length)| if i == at { odd } else { length }).collect()
        }
        1 => (0..n).map(|_| input.number()).collect(),
        _ => vec![input.number(); n],
    };
    let color: Vec<u8> = match input.flag() {
        true => (0..3 * n).map(|_| input.byte()).collect(),
        false => vec![input.byte(); 3 * n],
    };
    let depth = DepthBuffer {
        lengths: &lengths,
        kind: if input.flag() { DepthKind::Z } else { DepthKind::RayDistance },
        trusted: [0.0, f64::INFINITY],
    };
    Frame::from_memory("0", intrinsics, pose, ColorBuffer::Rgb8(&color), Some(depth)).ok()
}

/// The scene out of the checkpoint of itself.
fn reopened(config: &SceneConfig, scene: &dyn SceneLearner) -> Box<dyn SceneLearner> {
    let state = read_back(scene.stored(), scene.frames());
    let StoredModel::Scene(state) = state else { panic!("a scene is stored as one") };
    let restored = engine::restore(config, state, scene.frames()).expect("sums of its own form");
    assert!(restored.stored() == scene.stored(), "another scene comes back");
    restored
}

/// The scene with a part that learnt nothing since.
fn fused(config: &SceneConfig, scene: &dyn SceneLearner) -> Box<dyn SceneLearner> {
    let StoredModel::Scene(state) = scene.stored() else { panic!("a scene is stored as one") };
    let Some(fused) = engine::fuse(config, None, &[&state, &state]) else {
        return reopened(config, scene);
    };
    let StoredModel::Scene(fused) = read_back(StoredModel::Scene(fused), 2 * scene.frames()) else {
        panic!("a scene is stored as one")
    };
    engine::restore(config, fused, 2 * scene.frames()).expect("sums of its own form")
}

fn read_back(model: StoredModel, frames: u64) -> StoredModel {
    let text = || "{}".to_owned();
    let visited = (0..frames as u32).collect();
    let cursor = Cursor { frames, points: 0, visited };
    let checkpoint =
        Checkpoint { config: text(), meta: text(), numerics: text(), history: None, cursor, model };
    let bytes = to_bytes(&checkpoint);
    let read =
        parse(&bytes).unwrap_or_else(|defect| panic!("a scene that cannot be read: {defect}"));
    read.checkpoint.model
}

/// What holds whatever was seen.
fn check(config: &SceneConfig, scene: &dyn SceneLearner) {
    let stored = scene.stored_splats();
    let drawn = stored.iter().filter(|splat| splat.opacity > 0.0);
    let n_drawn = drawn.inspect(|splat| assert!(splat.is_valid(), "{splat:?}")).count();
    assert!(n_drawn <= config.max_components, "{n_drawn} of {}", config.max_components);
    if !config.births.is_order_invariant() {
        assert!(scene.used() <= config.max_components, "{} used", scene.used());
    }
    for component in 0..scene.components() {
        let posterior = scene.posterior(component);
        assert!(posterior.count >= 0.0, "{}", posterior.count);
    }
}
