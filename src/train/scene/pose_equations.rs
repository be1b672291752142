//! Normal equations of a camera's small motion: a turn about its centre, then a shift.

use super::align::Motion;
use crate::math::cholesky::Cholesky;
use glam::{DMat3, DVec3};

/// Standard deviation of a recorded orientation, radians.
const TURN_DEVIATION: f64 = 0.01;

/// Normal equations of turn (axis times angle, radians) and shift (world units), along the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PoseEquations {
    /// Row by row; the lower triangle.
    matrix: [f64; 36],
    right: [f64; 6],
}

impl PoseEquations {
    /// Of what says nothing.
    pub const NOTHING: Self = Self { matrix: [0.0; 36], right: [0.0; 6] };

    /// What the recorded pose says of the next step after `motion`, where shifts err by
    /// `shift_deviation`, world units.
    pub fn prior(motion: &Motion, shift_deviation: f64) -> Self {
        let mut equations = Self::NOTHING;
        let turn = motion.turn.to_scaled_axis();
        for axis in 0..3 {
            for (i, value, deviation) in [
                (axis, turn[axis], TURN_DEVIATION),
                (axis + 3, motion.shift[axis], shift_deviation),
            ] {
                equations.matrix[7 * i] = deviation.powi(-2);
                equations.right[i] = -value * deviation.powi(-2);
            }
        }
        equations
    }

    /// Adds other equations of the same motion.
    pub fn add(&mut self, other: &Self) {
        self.matrix.iter_mut().zip(other.matrix).for_each(|(a, b)| *a += b);
        self.right.iter_mut().zip(other.right).for_each(|(a, b)| *a += b);
    }

    /// Adds a residual that changes by `slope` with the position of what lies at `arm` from the
    /// camera and moves with it.
    pub fn add_residual(&mut self, residual: f64, slope: DVec3, arm: DVec3, weight: f64) {
        let turn = arm.cross(slope);
        let row = [turn.x, turn.y, turn.z, slope.x, slope.y, slope.z];
        for i in 0..6 {
            self.right[i] -= weight * residual * row[i];
            for j in 0..=i {
                self.matrix[6 * i + j] += weight * row[i] * row[j];
            }
        }
    }

    /// Adds what asks a surface at `arm` from the camera, which does not move with it, to move by `x`
    /// with `curvature·x = pull`: as the camera moves, the surface moves the other way before it.
    pub fn add_camera_motion(&mut self, arm: DVec3, pull: DVec3, curvature: DMat3) {
        // The surface moves by `arm × turn − shift`.
        let cross = DMat3::from_cols(
            DVec3::new(0.0, arm.z, -arm.y),
            DVec3::new(-arm.z, 0.0, arm.x),
            DVec3::new(arm.y, -arm.x, 0.0),
        );
        let (turn, shift) = (-arm.cross(pull), -pull);
        let turned = cross.transpose() * curvature;
        let (by_turns, mixed) = (turned * cross, -turned);
        for i in 0..3 {
            self.right[i] += turn[i];
            self.right[3 + i] += shift[i];
            for j in 0..3 {
                if j <= i {
                    self.matrix[6 * i + j] += by_turns.col(j)[i];
                    self.matrix[6 * (3 + i) + 3 + j] += curvature.col(j)[i];
                }
                self.matrix[6 * (3 + i) + j] += mixed.col(i)[j];
            }
        }
    }

    /// Turn (axis times angle) and shift; `None` unless all numbers are finite.
    pub fn solution(&self) -> Option<[DVec3; 2]> {
        let x = Cholesky::new(6, &self.matrix)?.solve(&self.right);
        let [turn, shift] = [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])];
        // The factor says nothing of the right side: a colour that is no number shows only here.
        (turn.is_finite() && shift.is_finite()).then_some([turn, shift])
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DQuat;

    /// Surfaces that stand still and ask to move as a motion of the camera would move them.
    #[test]
    fn surfaces_tell_how_the_camera_moved() {
        let (turn, shift) = (DVec3::new(0.002, -0.001, 0.003), DVec3::new(0.01, 0.02, -0.01));
        let mut equations = PoseEquations::NOTHING;
        for i in 0..9 {
            let i = f64::from(i);
            let arm = DVec3::new(i.sin(), (2.0 * i).cos(), 1.0 + 0.1 * i);
            let slope = DVec3::new(1.0, 0.3 * i, (3.0 * i).sin());
            let curvature = DMat3::from_cols(slope * slope.x, slope * slope.y, slope * slope.z);
            let moves = arm.cross(turn) - shift;
            equations.add_camera_motion(arm, curvature * moves, curvature);
        }
        let [found_turn, found_shift] = equations.solution().unwrap();
        assert!((found_turn - turn).length() < 1e-9, "{found_turn} for {turn}");
        assert!((found_shift - shift).length() < 1e-9, "{found_shift} for {shift}");
    }

    #[test]
    fn the_prior_pulls_back_to_the_recorded_pose() {
        let turn = DVec3::new(0.001, 0.0, -0.002);
        let shift = DVec3::new(0.0, 0.03, 0.0);
        let motion = Motion { turn: DQuat::from_scaled_axis(turn), shift };
        let [turned, shifted] = PoseEquations::prior(&motion, 0.02).solution().unwrap();
        assert!((turned + turn).length() < 1e-9 && (shifted + shift).length() < 1e-12);
    }
}
