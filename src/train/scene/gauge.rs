//! Rigid motion of a scene as a whole.
//!
//! Frames are aligned to the scene, and the scene is built from the frames. So their common pose is
//! determined only by the first frames. The pose errors of these frames affect all following
//! corrections. As recorded poses are unbiased on average, the whole scene is moved to where the
//! corrections of its frames are smallest.

use super::component_sums::ComponentSums;
use super::rigid_equations::{Motion, RigidEquations};
use crate::math::pose::Pose;
use crate::model::scene::state::SceneState;
use crate::model::splat::pose_log::FramePose;
use glam::{DMat3, DQuat, DVec3};

/// Returns the rigid motion of the world, from old to new coordinates, that minimises the pose
/// corrections of the frames. The solution is a least-squares fit, linear in small rotations. `turn`
/// and `shift` are the standard deviations of recorded rotations (radians) and positions (world units).
/// `None` if there are no frames or a recorded rotation is unknown.
pub fn common_motion(frames: &[FramePose], [turn, shift]: [f64; 2]) -> Option<Pose> {
    let poses: Vec<[Pose; 2]> = frames.iter().map(FramePose::poses).collect::<Option<_>>()?;
    let n = poses.len() as f64;
    let middle = poses.iter().fold(DVec3::ZERO, |sum, [_, real]| sum + real.centre() / n);
    let mut normal = RigidEquations::NONE;
    for [recorded, real] in &poses {
        let apart = Motion::between(recorded, real);
        // A rotation of the world rotates every camera and moves it in proportion to its distance from the
        // middle.
        let turned = Motion { turn: apart.turn, shift: DVec3::ZERO };
        // Of infinite deviation: the shift of a camera depends on its place and follows below.
        normal.add_equations(&RigidEquations::prior(&turned, [turn, f64::INFINITY]));
        let weight = shift.powi(-2);
        let arm = real.centre() - middle;
        normal.add_all(DMat3::from_diagonal(DVec3::splat(weight)), weight * apart.shift, arm);
    }
    let [turn, shift] = normal.solution()?;
    let turn = DQuat::from_scaled_axis(turn);
    Some(Pose::IDENTITY.attached_camera(middle + shift - turn * middle, turn))
}

/// Returns the root mean square rotation (radians) and translation (world units) of the frames' pose corrections without
/// the motion common to all of them. `deviations` are those of [`common_motion`]. `None` if there are too few frames or
/// a recorded rotation is unknown.
pub fn own_corrections(frames: &[FramePose], deviations: [f64; 2]) -> Option<[f64; 2]> {
    let common = common_motion(frames, deviations)?;
    let own: Vec<FramePose> =
        frames.iter().map(|frame| frame.moved(&common)).collect::<Option<_>>()?;
    let rms = |of: fn(&FramePose) -> [f64; 3]| {
        let squares = own.iter().map(|frame| DVec3::from_array(of(frame)).length_squared());
        (squares.sum::<f64>() / own.len() as f64).sqrt()
    };
    Some([rms(|frame| frame.turn), rms(|frame| frame.shift)])
}

/// Applies a rigid motion of the whole world to a seed. Seed and result are relative to `origin`, world units.
pub fn moved_seed(seed: [f32; 3], origin: DVec3, motion: &Pose) -> [f32; 3] {
    let place = origin + DVec3::from_array(seed.map(f64::from));
    (motion.transform_point(place) - origin).as_vec3().to_array()
}

/// Applies a rigid motion of the world to a scene: seeds, sums, splats, logs and cameras of buffered
/// photographs. `None` if the recorded rotation of a frame is unknown.
pub fn moved(state: SceneState, motion: &Pose) -> Option<SceneState> {
    let origin = DVec3::from_array(state.origin);
    let mut sums = ComponentSums::restore(state.sums, state.visibility);
    sums.rotate(motion.rotation());
    let (sums, visibility) = sums.state();
    let mut photometric = state.photometric;
    if let Some(photometric) = &mut photometric {
        photometric.move_by(motion);
    }
    Some(SceneState {
        seeds: state.seeds.into_iter().map(|seed| moved_seed(seed, origin, motion)).collect(),
        sums,
        visibility,
        exposures: state.exposures.iter().map(|frame| frame.moved(motion)).collect(),
        poses: state.poses.iter().map(|frame| frame.moved(motion)).collect::<Option<_>>()?,
        photometric,
        ..state
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recorded(i: usize) -> Pose {
        let angle = i as f64 * 0.4;
        let eye = DVec3::new(angle.cos(), angle.sin(), 0.2 * (i % 3) as f64);
        Pose::look_at(eye, DVec3::new(3.0, -2.0, 1.0), DVec3::Z).unwrap()
    }

    #[test]
    fn what_all_frames_err_by_is_told_from_what_each_errs_by() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.015));
        let by = Pose::IDENTITY.attached_camera(DVec3::new(0.02, -0.01, 0.03), turn);
        let frame = |i: usize| {
            let own = if i.is_multiple_of(2) { 0.004 } else { -0.004 };
            let real = recorded(i / 2).transformed_by(&by);
            FramePose::new(&recorded(i / 2), &real.attached_camera(DVec3::X * own, DQuat::IDENTITY))
        };
        let frames: Vec<FramePose> = (0..32).map(frame).collect();
        let motion = common_motion(&frames, [0.01, 0.02]).unwrap();
        for i in 0..16 {
            let back = recorded(i).transformed_by(&by).transformed_by(&motion);
            // The solution is linear in rotations of a hundredth.
            assert!((back.centre() - recorded(i).centre()).length() < 1e-3);
            assert!((back.forward() - recorded(i).forward()).length() < 1e-3);
        }
        let moved = frames[3].moved(&motion).unwrap();
        assert!(DVec3::from_array(moved.shift).length() < 0.0045);
        assert_eq!(moved.recorded, frames[3].recorded);
    }

    #[test]
    fn corrections_without_the_common_motion_are_those_of_each_frame() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.01, -0.02, 0.015));
        let by = Pose::IDENTITY.attached_camera(DVec3::new(0.02, -0.01, 0.03), turn);
        let frame = |i: usize| {
            let sign = if i.is_multiple_of(2) { 1.0 } else { -1.0 };
            let (shift, turn) = (0.004 * sign * DVec3::X, DQuat::from_rotation_z(0.002 * sign));
            let real = recorded(i / 2).transformed_by(&by).attached_camera(shift, turn);
            FramePose::new(&recorded(i / 2), &real)
        };
        let frames: Vec<FramePose> = (0..32).map(frame).collect();
        let [turn, shift] = own_corrections(&frames, [0.01, 0.02]).unwrap();
        assert!((turn - 0.002).abs() < 3e-4 && (shift - 0.004).abs() < 3e-4, "{turn} {shift}");
        assert_eq!(own_corrections(&[], [0.01, 0.02]), None);
    }

    #[test]
    fn frames_that_do_not_know_how_they_were_recorded_hold_nothing() {
        let known = FramePose::new(&recorded(0), &recorded(1));
        let old = FramePose { rotation: [0.0; 4], ..known };
        assert!(common_motion(&[known, known], [0.01, 0.02]).is_some());
        assert_eq!(common_motion(&[known, old], [0.01, 0.02]), None);
        assert_eq!(common_motion(&[], [0.01, 0.02]), None);
    }
}
