//! Drift of recorded poses: a random walk over the frames.

use crate::math::pose::Pose;
use crate::math::rng::{Purpose, Rng};
use glam::{DQuat, DVec3};

/// Random stream of the drift.
const STREAM: u64 = u64::MAX - 3;
/// Range of the maximum position error of a recording, metres.
const LARGEST_OFFSET: [f64; 2] = [0.002, 0.003];
/// Maximum rotation error of a recording, degrees.
const LARGEST_TURN: f64 = 0.2;

/// Poses with drift, as a recording states them for frames taken at `poses`; the first is exact.
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

/// Smooth random walk from zero, scaled to a maximum distance of `largest`.
fn walk(n: usize, largest: f64, rng: &mut Rng) -> Vec<DVec3> {
    let (mut place, mut pace) = (DVec3::ZERO, DVec3::ZERO);
    let mut places = Vec::with_capacity(n);
    for _ in 0..n {
        places.push(place);
        pace = 0.8 * pace + DVec3::from_array([(); 3].map(|()| rng.normal()));
        // Mean reversion: a tracker relocalises against known places.
        place = 0.97 * place + pace;
    }
    let farthest = places.iter().fold(0.0f64, |most, place| most.max(place.length()));
    let scale = if farthest > 0.0 { largest / farthest } else { 0.0 };
    places.iter().map(|place| *place * scale).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

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
