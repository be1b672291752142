//! Least squares for a small rigid motion of a camera and its points, for pose alignment and tracking.

use crate::math::camera::Camera;
use crate::math::cholesky::Cholesky;
use crate::math::pose::Pose;
use crate::math::sym3::Sym3;
use crate::observation::surface::{Observation, SurfacePoint};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Small rigid motion of a camera and its points, in world axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Rotation about the camera centre.
    pub turn: DQuat,
    /// Translation after the rotation, world units.
    pub shift: DVec3,
}

impl Motion {
    pub fn between(from: &Pose, to: &Pose) -> Self {
        // Normalised, since products of rotation matrices drift by rounding.
        let turn = DQuat::from_mat3(&(to.rotation() * from.rotation().transpose())).normalize();
        Self { turn, shift: to.centre() - from.centre() }
    }

    /// Returns a function that applies this motion to a frame's points. The function returns positions
    /// relative to [`Observation::origin`], world units.
    pub fn point_mover(
        &self,
        frame: &Observation,
    ) -> impl Fn(&SurfacePoint) -> [f32; 3] + Sync + use<> {
        let (turn, shift) = (DMat3::from_quat(self.turn), self.shift);
        let centre = frame.camera.pose.centre() - frame.origin;
        move |point| array(centre + turn * (point.position_vector() - centre) + shift)
    }

    /// Replaces `points` by the moved points of a frame and returns the moved camera.
    pub fn apply(&self, frame: &Observation, points: &mut Vec<SurfacePoint>) -> Camera {
        let Camera { intrinsics, pose } = frame.camera;
        let (turn, place) = (DMat3::from_quat(self.turn), self.point_mover(frame));
        let moved = |point: &SurfacePoint| SurfacePoint {
            position: place(point),
            normal: array(turn * point.normal_vector()),
            direction: array(turn * point.direction_vector()),
            ..*point
        };
        frame.points.par_iter().with_min_len(1024).map(moved).collect_into_vec(points);
        Camera { intrinsics, pose: self.apply_to_pose(&pose) }
    }

    pub fn apply_to_pose(&self, pose: &Pose) -> Pose {
        let world_from_camera = DQuat::from_mat3(&pose.rotation());
        let turn = world_from_camera.inverse() * self.turn * world_from_camera;
        pose.attached_camera(world_from_camera.inverse() * self.shift, turn)
    }
}

/// Normal equations for the least-squares estimate of a [`Motion`].
pub(super) struct RigidEquations {
    /// For each parameter: its row of the matrix, its entry of the negative right-hand side, and a zero
    /// that pads to eight numbers.
    rows: [[f64; 8]; 6],
}

impl RigidEquations {
    pub const NONE: Self = Self { rows: [[0.0; 8]; 6] };

    /// Returns the equations of a prior of zero motion, linearised at `motion`. The standard deviations
    /// refer to rotation (radians) and translation (world units).
    pub fn prior(motion: &Motion, [turn_deviation, shift_deviation]: [f64; 2]) -> Self {
        let mut normal = Self::NONE;
        let turn = motion.turn.to_scaled_axis();
        for axis in 0..3 {
            for (i, value, deviation) in [
                (axis, turn[axis], turn_deviation),
                (axis + 3, motion.shift[axis], shift_deviation),
            ] {
                normal.rows[i][i] = deviation.powi(-2);
                // The prior is about no motion, so the residual is the motion so far.
                normal.rows[i][6] = value * deviation.powi(-2);
            }
        }
        normal
    }

    /// Adds a residual of a point. `arm` is the vector from the camera centre to the point. `slope` is
    /// the gradient of the residual with respect to the point's position.
    pub fn add(&mut self, residual: f64, slope: DVec3, arm: DVec3, weight: f64) {
        let turn = arm.cross(slope);
        let row = [turn.x, turn.y, turn.z, slope.x, slope.y, slope.z, residual, 0.0];
        for (sums, along) in self.rows.iter_mut().zip(row) {
            let along = weight * along;
            sums.iter_mut().zip(row).for_each(|(sum, across)| *sum += along * across);
        }
    }

    /// Adds several residuals of a point. `arm` is the vector from the camera centre to the point. With
    /// residuals `r`, slopes `s` and weights `w`, `information` is `Σ w s sᵀ` and `pull` is `Σ w r s`.
    pub fn add_all(&mut self, information: DMat3, pull: DVec3, arm: DVec3) {
        let crossed = |m: DMat3| {
            DMat3::from_cols(arm.cross(m.x_axis), arm.cross(m.y_axis), arm.cross(m.z_axis))
        };
        let mixed = crossed(information);
        let across = mixed.transpose();
        let turn = crossed(across);
        let turned_pull = arm.cross(pull);
        for axis in 0..3 {
            for (row, [left, right], pull) in [
                (axis, [turn, mixed], turned_pull[axis]),
                (axis + 3, [across, information], pull[axis]),
            ] {
                let row = &mut self.rows[row];
                for column in 0..3 {
                    row[column] += left.col(column)[axis];
                    row[column + 3] += right.col(column)[axis];
                }
                row[6] += pull;
            }
        }
    }

    pub fn add_equations(&mut self, part: &Self) {
        self.add_weighted(part, 1.0);
    }

    /// Adds equations whose residuals have the given weight.
    pub fn add_weighted(&mut self, part: &Self, weight: f64) {
        for (sums, more) in self.rows.iter_mut().zip(&part.rows) {
            sums.iter_mut().zip(more).for_each(|(sum, more)| *sum += weight * more);
        }
    }

    fn matrix(&self) -> [f64; 36] {
        std::array::from_fn(|i| self.rows[i / 6][i % 6])
    }

    /// Returns the rotation (axis times angle, radians) and translation (world units) that solve the
    /// equations. `None` if there is no finite solution.
    pub fn solution(&self) -> Option<[DVec3; 2]> {
        let x = Cholesky::new(6, &self.matrix())?.solve(&self.rows.map(|row| -row[6]));
        let [turn, shift] = [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])];
        // The factor does not depend on the right-hand side: a NaN colour shows only here.
        (turn.is_finite() && shift.is_finite()).then_some([turn, shift])
    }

    /// Returns the standard deviations of rotation (radians) and translation (world units) along the least
    /// certain axes; `None` unless all numbers are finite.
    pub fn deviations(&self) -> Option<[f64; 2]> {
        let factor = Cholesky::new(6, &self.matrix())?;
        let column =
            |i: usize| factor.solve(&std::array::from_fn::<_, 6, _>(|k| f64::from(k == i)));
        let inverse: [Vec<f64>; 6] = std::array::from_fn(column);
        let largest = |first: usize| {
            let axis = |i: usize| DVec3::from_slice(&inverse[first + i][first..first + 3]);
            Sym3::from_mat3(DMat3::from_cols(axis(0), axis(1), axis(2))).eigen().values.x.sqrt()
        };
        let found = [largest(0), largest(3)];
        found.iter().all(|deviation| deviation.is_finite()).then_some(found)
    }
}

fn array(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};

    #[test]
    fn a_prior_alone_undoes_the_motion_within_its_deviations() {
        let turn = DQuat::from_scaled_axis(DVec3::new(0.1, 0.0, 0.0));
        let motion = Motion { turn, shift: DVec3::new(0.0, 2.0, -1.0) };
        let prior = RigidEquations::prior(&motion, [0.5, 2.0]);
        let [turn, shift] = prior.solution().unwrap();
        assert!((turn + DVec3::new(0.1, 0.0, 0.0)).length() < 1e-12);
        assert!((shift + motion.shift).length() < 1e-12);
        assert_eq!(prior.deviations(), Some([0.5, 2.0]));
        // Four times the weight halves the deviations.
        let mut heavier = RigidEquations::NONE;
        heavier.add_equations(&prior);
        heavier.add_weighted(&prior, 3.0);
        assert_eq!(heavier.deviations(), Some([0.25, 1.0]));
        assert_eq!(RigidEquations::NONE.solution(), None);
        let pose = Pose::look_at(DVec3::new(1.0, 2.0, 3.0), DVec3::ZERO, DVec3::Z).unwrap();
        let found = Motion::between(&pose, &motion.apply_to_pose(&pose));
        assert!((found.shift - motion.shift).length() < 1e-12);
        assert!(found.turn.angle_between(motion.turn) < 1e-7);
    }

    #[test]
    fn residuals_of_one_arm_are_added_alike_one_by_one_and_at_once() {
        let mut rng = Rng::new(7, Purpose::Synthetic, 0);
        let mut vector = || DVec3::from_array([0; 3].map(|_| rng.range(-1.0, 1.0)));
        let (mut single, mut joint) = (RigidEquations::NONE, RigidEquations::NONE);
        for _ in 0..20 {
            let arm = vector();
            let (mut information, mut pull) = (DMat3::ZERO, DVec3::ZERO);
            for _ in 0..4 {
                let (slope, numbers) = (vector(), vector());
                let (residual, weight) = (numbers.x, numbers.y.abs());
                single.add(residual, slope, arm, weight);
                let weighted = weight * slope;
                information +=
                    DMat3::from_cols(weighted * slope.x, weighted * slope.y, weighted * slope.z);
                pull += residual * weighted;
            }
            joint.add_all(information, pull, arm);
        }
        let pairs = single.rows.as_flattened().iter().zip(joint.rows.as_flattened());
        for (single, joint) in pairs {
            assert!((single - joint).abs() < 1e-12, "{single} {joint}");
        }
    }
}
