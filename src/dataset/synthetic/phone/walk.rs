//! Path of the hand-held phone through its scenes.

use crate::dataset::synthetic::params::PhoneScene;
use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DQuat, DVec2, DVec3, EulerRot, dvec3};
use std::f64::consts::TAU;

const PHASES: u64 = u64::MAX - 2;
/// Amplitudes of hand shake: translation (metres) and rotation (radians).
const SHAKE: [f64; 2] = [0.004, 0.006];
/// Base frequency of hand shake, cycles per duration of the walk.
const SWINGS: f64 = 47.0;

/// Path of the phone through a scene, parameterised from 0 to 1.
#[derive(Clone, Copy, Debug)]
pub struct Walk {
    scene: PhoneScene,
    phases: [f64; 4],
}

impl Walk {
    pub fn new(scene: PhoneScene, seed: u64) -> Self {
        let mut rng = Rng::new(seed, Purpose::Synthetic, PHASES);
        Self { scene, phases: [(); 4].map(|()| rng.uniform()) }
    }

    /// Returns the walk parameter, from 0 to 1, of a frame out of `n_frames`. Fractional frames
    /// interpolate. The pace varies: during slow frames the phone hardly moves, and fast frames have
    /// motion blur.
    pub fn walk_parameter(&self, frame: f64, n_frames: usize) -> f64 {
        const HURRIES: f64 = 5.0;
        let even = frame / n_frames.max(1) as f64;
        let [.., phase] = self.phases;
        let wave = |x: f64| (TAU * (HURRIES * x + phase)).sin();
        // The pace stays above a quarter of the mean, so that time never runs backwards.
        even + 0.75 / (TAU * HURRIES) * (wave(even) - wave(0.0))
    }

    pub fn shaken_pose(&self, part: f64) -> Pose {
        let [a, b, c, d] = self.phases;
        let swing = |rate: f64, phase: f64| (TAU * (SWINGS * rate * part + phase)).sin();
        let offset = dvec3(swing(1.0, a), swing(0.83, b), 0.5 * swing(0.61, c)) * SHAKE[0];
        let [x, y, z] =
            [swing(0.77, c), swing(1.1, d), 0.7 * swing(0.53, a)].map(|angle| angle * SHAKE[1]);
        self.steady(part).attached_camera(offset, DQuat::from_euler(EulerRot::XYZ, x, y, z))
    }

    pub fn steady(&self, part: f64) -> Pose {
        let (eye, forward) = match self.scene {
            PhoneScene::Room => self.in_room(part),
            PhoneScene::Door => self.at_door(part),
        };
        // Never falls back: the view direction is never vertical.
        Pose::look_at(eye, eye + forward, DVec3::Z).unwrap_or(Pose::IDENTITY)
    }

    /// Returns camera position and view direction on two turns around the room. The first turn faces the
    /// centre of the room, the second the walls ahead.
    fn in_room(&self, part: f64) -> (DVec3, DVec3) {
        let [phase, rise, ..] = self.phases;
        let turn = phase + 2.0 * part;
        let reach = 0.92 + 0.06 * (TAU * 3.0 * part).sin();
        // The path of the room's camera, which avoids the furniture.
        let flat = DVec2::from_angle(TAU * turn) * DVec2::new(1.75, 1.45) * reach;
        let eye = flat.extend(1.4 + 0.22 * (TAU * (3.0 * part + rise)).sin());
        let target = dvec3(0.0, 0.0, 0.75 + 0.35 * (TAU * 5.0 * part).sin());
        let aside = smooth((part - 0.42) / 0.2) - smooth((part - 0.92) / 0.2);
        let inward = (target - eye).normalize_or(DVec3::X);
        let turned = DQuat::from_rotation_z(-115f64.to_radians() * aside) * inward;
        // Covers floor, walls and ceiling alternately.
        let nod = aside * (0.25 + 0.4 * (TAU * 5.0 * part).sin());
        (eye, turned + DVec3::Z * nod)
    }

    /// Returns camera position and view direction on arcs around points of the door, at varying
    /// distance.
    fn at_door(&self, part: f64) -> (DVec3, DVec3) {
        let [a, b, ..] = self.phases;
        let wave = |rate: f64, phase: f64| (TAU * (rate * part + phase)).sin();
        let target = dvec3(0.36 * wave(3.0, a), 0.0, 1.05 + 0.6 * wave(1.0, b));
        let distance = 0.95 - 0.43 * (TAU * 2.0 * part).cos();
        let angle = 32f64.to_radians() * wave(2.0, 0.1);
        let rise = 8f64.to_radians() * wave(3.5, 0.3);
        let way = dvec3(angle.sin() * rise.cos(), -angle.cos() * rise.cos(), rise.sin());
        let mut eye = target + way * distance;
        eye.z = eye.z.clamp(0.4, 1.75);
        (eye, target - eye)
    }
}

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

const STREAM: u64 = u64::MAX - 3;
/// Range from which the maximum position error of a recording is drawn, metres.
const LARGEST_OFFSET: [f64; 2] = [0.002, 0.003];
/// Maximum rotation error of a recording, degrees.
const LARGEST_TURN: f64 = 0.2;

/// Adds smooth random drift to true poses, as it occurs in a phone's tracking. The first pose remains
/// exact.
pub fn with_drift(poses: &[Pose], seed: u64) -> Vec<Pose> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, STREAM);
    let [low, high] = LARGEST_OFFSET;
    let largest = rng.range(low, high);
    let offsets = walk(poses.len(), largest, &mut rng);
    let turns = walk(poses.len(), LARGEST_TURN.to_radians(), &mut rng);
    let errors = offsets.into_iter().zip(turns);
    let moved = |(pose, (offset, turn)): (&Pose, (DVec3, DVec3))| {
        pose.attached_camera(offset, DQuat::from_scaled_axis(turn))
    };
    poses.iter().zip(errors).map(moved).collect()
}

fn walk(n: usize, largest: f64, rng: &mut Rng) -> Vec<DVec3> {
    let (mut place, mut pace) = (DVec3::ZERO, DVec3::ZERO);
    let mut places = Vec::with_capacity(n);
    for _ in 0..n {
        places.push(place);
        // Correlated steps give a smooth path.
        pace = 0.8 * pace + DVec3::from_array([(); 3].map(|()| rng.normal()));
        // Mean reversion: a tracker relocalises against known places.
        place = 0.97 * place + pace;
    }
    let farthest = places.iter().fold(0.0f64, |most, place| most.max(place.length()));
    // A single frame has no drift to scale.
    let scale = if farthest > 0.0 { largest / farthest } else { 0.0 };
    places.iter().map(|place| *place * scale).collect()
}

#[cfg(test)]
mod tests {
    use super::super::contents::furnish;
    use super::*;

    #[test]
    fn the_phone_stays_in_free_space() {
        for (scene, seed) in [(PhoneScene::Room, 0), (PhoneScene::Door, 0), (PhoneScene::Door, 9)] {
            let (room, walk) = (furnish(scene, seed), Walk::new(scene, seed));
            for i in 0..400 {
                let eye = walk.shaken_pose(walk.walk_parameter(i as f64, 400)).centre();
                for solid in &room.solids {
                    let away = solid.shape.distance(eye);
                    assert!(away > 0.2, "{scene:?} {i}: {eye} is {away} m from {solid:?}");
                }
            }
        }
    }

    #[test]
    fn drift_starts_at_zero_and_stays_small_and_smooth() {
        let pose = Pose::look_at(DVec3::X, DVec3::Y, DVec3::Z).unwrap();
        for seed in 0..20 {
            let errors: Vec<(DVec3, DQuat)> =
                with_drift(&[pose; 70], seed).iter().map(|stated| pose.offset_to(stated)).collect();
            assert!(errors[0].0.length() < 1e-12, "the first pose is exact");
            let largest =
                |value: fn(&(DVec3, DQuat)) -> f64| errors.iter().map(value).fold(0.0, f64::max);
            let offset = largest(|(offset, _)| offset.length());
            assert!((0.002..0.003 + 1e-9).contains(&offset), "{offset} m");
            let turn = largest(|(_, turn)| turn.to_scaled_axis().length().to_degrees());
            assert!((turn - 0.2).abs() < 1e-6, "{turn} degrees");
            let steps = errors.array_windows().map(|[a, b]| (b.0 - a.0).length());
            assert!(steps.fold(0.0, f64::max) < 0.5 * offset, "consecutive frames are similar");
        }
        assert_eq!(with_drift(&[pose], 3), [pose]);
    }
}
