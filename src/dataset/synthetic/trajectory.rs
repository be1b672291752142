//! Trajectory of the synthetic camera: around the room, facing the table.

use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DVec3, dvec3};
use std::f64::consts::TAU;

/// Frames per turn around the room; longer trajectories make more turns at varying heights.
const FRAMES_PER_TURN: f64 = 48.0;
/// Semi-axes of the elliptic path, metres.
const PATH: [f64; 2] = [1.75, 1.45];
/// Mean and amplitude of the camera height, metres.
const HEIGHT: [f64; 2] = [1.4, 0.3];
/// Mean target point of the camera, metres.
const TARGET: DVec3 = dvec3(0.0, 0.0, 0.85);
/// Random stream of the phase; distinct from those of frames and furnishing.
const PHASE: u64 = u64::MAX - 1;

/// Poses of the training frames: smooth, one or more closed turns.
pub(super) fn train(n_frames: usize, seed: u64) -> Vec<Pose> {
    // Whole turns close the path.
    let turns = (n_frames as f64 / FRAMES_PER_TURN).round().max(1.0);
    let phase = phase(seed);
    (0..n_frames).filter_map(|i| pose(phase + turns * i as f64 / n_frames as f64, turns)).collect()
}

/// Poses of the evaluation frames, at a different radius and height profile than the training frames.
pub(super) fn eval(n_frames: usize, seed: u64) -> Vec<Pose> {
    // The offset avoids training viewpoints at the usual frame counts.
    let phase = phase(seed) + 0.37 / FRAMES_PER_TURN;
    let between = |i: usize| {
        let turn = phase + i as f64 / n_frames as f64;
        let eye = path_position(turn, 0.93, HEIGHT[0] + 0.2 * (TAU * 3.0 * turn).sin());
        Pose::look_at(eye, target(turn + 0.11), DVec3::Z)
    };
    (0..n_frames).filter_map(between).collect()
}

fn phase(seed: u64) -> f64 {
    // Seed 0 is the demo, whose first view was chosen by hand.
    if seed == 0 { 0.89 } else { Rng::new(seed, Purpose::Synthetic, PHASE).uniform() }
}

/// Never `None`: the path avoids the vertical through the target.
fn pose(turn: f64, turns: f64) -> Option<Pose> {
    let swing = (TAU * turn * (1.0 + 1.0 / turns)).sin();
    let eye = path_position(turn, 1.0, HEIGHT[0] + HEIGHT[1] * swing);
    Pose::look_at(eye, target(turn), DVec3::Z)
}

fn path_position(turn: f64, reach: f64, height: f64) -> DVec3 {
    let (sin, cos) = (TAU * turn).sin_cos();
    dvec3(PATH[0] * reach * cos, PATH[1] * reach * sin, height)
}

/// The target oscillates, so that floor and ceiling become visible as well.
fn target(turn: f64) -> DVec3 {
    let sway = TAU * turn;
    TARGET + dvec3(0.25 * (2.0 * sway).sin(), 0.2 * (3.0 * sway).cos(), 0.35 * (5.0 * sway).sin())
}

#[cfg(test)]
mod tests {
    use super::super::room::{FurnishedRoom, HI, LO};
    use super::*;

    #[test]
    fn cameras_stand_in_free_space() {
        let room = FurnishedRoom::new(3);
        let poses = [train(96, 0), eval(24, 0), train(1, 5), eval(1, 5), train(7, 9)].concat();
        assert_eq!(poses.len(), 96 + 24 + 1 + 1 + 7, "every frame has a pose");
        for pose in poses {
            let eye = pose.centre();
            assert!(eye.cmpgt(LO).all() && eye.cmplt(HI).all(), "{eye}");
            for solid in &room.solids[1..] {
                let (lo, hi) = solid.shape.bounds();
                let outside = (lo - eye).max(eye - hi).max_element();
                assert!(outside > 0.15, "{eye} is {outside} m from {solid:?}");
            }
        }
    }
}
