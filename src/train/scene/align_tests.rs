//! Alignment of frames, by a trainer that knows the scene.

use super::config::SceneConfig;
use super::trainer::SceneTrainer;
use crate::math::rng::{Purpose, Rng};
use crate::observation::surface::{Observation, SurfacePoint};
use glam::{DQuat, DVec3};

/// Three walls of a room with a painted pattern, seen from a point inside it.
fn room(turn: DQuat, shift: DVec3) -> Observation {
    let mut rng = Rng::new(3, Purpose::Synthetic, 0);
    let point = |_| {
        let [u, v] = [0; 2].map(|_| rng.range(-1.0, 1.0));
        let wall = (3.0 * rng.range(0.0, 1.0)) as usize;
        let (mut position, mut normal) = (DVec3::ZERO, DVec3::ZERO);
        (position[wall], position[(wall + 1) % 3], position[(wall + 2) % 3]) = (1.0, u, v);
        normal[wall] = -1.0;
        let color = DVec3::splat(0.5) + 0.4 * (9.0 * position).map(f64::sin);
        // What the camera believes: it stood turned and shifted.
        let [position, normal] = [turn * position + shift, turn * normal];
        SurfacePoint {
            position: position.as_vec3().to_array(),
            range: 1.4,
            color: color.as_vec3().to_array(),
            noise: 0.003,
            normal: normal.as_vec3().to_array(),
            footprint: 0.01,
            direction: position.normalize().as_vec3().to_array(),
            pixel: 0,
        }
    };
    let mut frame = Observation::empty();
    frame.points = (0..60_000).map(point).collect();
    frame.tolerance.refinement = 0.03;
    frame
}

#[test]
fn a_wrong_pose_is_found() {
    let config = SceneConfig { refine: false, gain: false, ..SceneConfig::coarse(0.05) };
    let mut trainer = SceneTrainer::<f64>::new(&config, DVec3::ZERO);
    for _ in 0..2 {
        trainer.train(&room(DQuat::IDENTITY, DVec3::ZERO));
    }
    let turn = DQuat::from_scaled_axis(DVec3::new(0.004, -0.003, 0.005));
    let shift = DVec3::new(0.006, -0.004, 0.003);
    let frame = room(turn, shift);
    let found = trainer.motion(&frame).unwrap();
    // The motion undoes the error: turn, then shift, about the camera at the origin.
    let rest = found.turn * turn;
    assert!(rest.to_axis_angle().1.abs() < 2e-4, "{found:?}");
    assert!((found.turn * shift + found.shift).length() < 4e-4, "{found:?}");
    let mut points = Vec::new();
    let camera = found.apply(&frame, &mut points);
    assert!((camera.pose.centre() - found.shift).length() < 1e-12);
    let right = room(DQuat::IDENTITY, DVec3::ZERO);
    for (moved, right) in points.iter().zip(&right.points) {
        assert!((vector(moved.position) - vector(right.position)).length() < 1e-3);
        assert!((vector(moved.normal) - vector(right.normal)).length() < 1e-3);
    }
}

/// As far as cameras are off that lost their way for a moment: 2 cm and a degree.
#[test]
fn a_pose_that_is_far_off_is_pulled_back() {
    let config = SceneConfig { refine: false, gain: false, ..SceneConfig::coarse(0.05) };
    let mut trainer = SceneTrainer::<f64>::new(&config, DVec3::ZERO);
    for _ in 0..2 {
        trainer.train(&room(DQuat::IDENTITY, DVec3::ZERO));
    }
    for axis in DVec3::AXES {
        let (turn, shift) = (DQuat::from_axis_angle(axis, 0.0175), 0.02 * axis);
        let found = trainer.motion(&room(turn, shift)).unwrap();
        let rest = (found.turn * turn).to_axis_angle().1.abs();
        let left = (found.turn * shift + found.shift).length();
        assert!(rest < 0.2 * 0.0175 && left < 0.2 * 0.02, "{rest} rad and {left} are left");
    }
}

#[test]
fn an_unknown_scene_moves_nothing() {
    let mut trainer = SceneTrainer::<f64>::new(&SceneConfig::coarse(0.05), DVec3::ZERO);
    assert_eq!(trainer.motion(&room(DQuat::IDENTITY, DVec3::ZERO)), None);
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}
