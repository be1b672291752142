//! Search over rotations of a camera, on a grid and at the coarsest resolution.
//!
//! Gauss–Newton converges from an error of up to two or three pixels of the coarsest level. Between
//! infrequent frames, hand-held cameras rotate by many times that angle, but their translation is
//! small. So only rotations are searched.

use super::reference::ReferenceLevel;
use super::samples::Sample;
use crate::math::pose::Pose;
use glam::{DMat3, DQuat, DVec3, EulerRot};
use rayon::prelude::*;

/// Maximum rotations that are tried: pitch, yaw and roll, radians.
const REACH: [f64; 3] = [0.5, 0.6, 0.45];
/// Steps of the grid in pitch, yaw and roll, in pixel angles of the coarsest level. A step in roll moves
/// the rim of the picture about as far as a step in pitch or yaw.
const STEP: [f64; 3] = [2.5, 2.5, 5.0];
/// Approximate number of samples that are compared.
const SAMPLES: usize = 400;
/// Relative depth difference and brightness difference (in `[0, 1]`) at which the weight of a sample is
/// one half.
const TOLERANCE: [f64; 2] = [0.06, 0.1];
/// Score of a sample that falls outside the rendered scene.
const UNKNOWN: f64 = 0.15;

/// Returns up to `most` rotated copies of the pose `guess`: those at which a frame agrees best with the
/// scene, best first. The scene is rendered from the pose `from`.
pub fn search(
    samples: &[Sample],
    (level, from): (&ReferenceLevel, &Pose),
    guess: &Pose,
    most: usize,
) -> Vec<Pose> {
    let step = STEP.map(|pixels| pixels * level.pixel_angle());
    // Every rotation of the grid compares all samples, so few must do.
    let every = (samples.len() / SAMPLES).max(1);
    let samples: Vec<Sample> = samples.iter().step_by(every).copied().collect();
    let counts = [0, 1, 2].map(|axis| (REACH[axis] / step[axis]).floor() as i32);
    let mut turns = Vec::new();
    for pitch in -counts[0]..=counts[0] {
        for yaw in -counts[1]..=counts[1] {
            turns.extend((-counts[2]..=counts[2]).map(|roll| [pitch, yaw, roll]));
        }
    }
    let pose = |turn: &[i32; 3]| {
        let [pitch, yaw, roll] = [0, 1, 2].map(|axis| f64::from(turn[axis]) * step[axis]);
        guess.attached_camera(DVec3::ZERO, DQuat::from_euler(EulerRot::YXZ, yaw, pitch, roll))
    };
    let scores = turns.par_iter().with_min_len(16);
    let scores: Vec<f64> = scores.map(|turn| score(&samples, level, from, &pose(turn))).collect();
    let mut order: Vec<usize> = (0..turns.len()).collect();
    order.sort_by(|&a, &b| scores[b].total_cmp(&scores[a]));
    let mut found: Vec<[i32; 3]> = Vec::new();
    for i in order {
        // Neighbours of a peak converge to the same pose.
        let is_new = |other: &[i32; 3]| (0..3).any(|axis| (other[axis] - turns[i][axis]).abs() > 1);
        if found.iter().all(is_new) {
            found.push(turns[i]);
        }
        if found.len() == most {
            break;
        }
    }
    found.iter().map(pose).collect()
}

/// Returns the mean score of a frame's samples at a pose, 0 to 1.
fn score(samples: &[Sample], level: &ReferenceLevel, from: &Pose, pose: &Pose) -> f64 {
    let turn: DMat3 = from.rotation().transpose() * pose.rotation();
    let shift = from.rotation().transpose() * (pose.centre() - from.centre());
    let mut seen: Vec<[f64; 3]> = Vec::with_capacity(samples.len());
    let (mut above, mut below, mut unknown) = (0.0, 0.0, 0.0);
    for sample in samples {
        let point = turn * sample.position + shift;
        match level.nearest(point) {
            Some([shown, depth]) if depth > 0.0 => {
                let apart = (depth - point.z) / (TOLERANCE[0] * depth);
                let agreement = 1.0 / (1.0 + apart * apart);
                above += agreement * shown * sample.brightness;
                below += agreement * sample.brightness * sample.brightness;
                seen.push([agreement, shown, sample.brightness]);
            }
            _ => unknown += 1.0,
        }
    }
    let gain = if below > 0.0 { above / below } else { 1.0 };
    let agreed: f64 = seen
        .iter()
        .map(|[agreement, shown, brightness]| {
            let apart = (shown - gain * brightness) / TOLERANCE[1];
            agreement / (1.0 + apart * apart)
        })
        .sum();
    (agreed + UNKNOWN * unknown) / samples.len().max(1) as f64
}
