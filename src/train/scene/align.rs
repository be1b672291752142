//! Where a frame's camera stood, given the scene: recorded poses of real cameras err by more than the
//! structural scale.
//!
//! Every component that is known already says two things of the frame's points it owns: they lie in
//! its plane, and their mean colour is that of its joint Gaussian of position and colour there. The
//! most probable small motion of the camera under both and under a prior about the recorded pose
//! (MAP, Gauss–Newton with Cauchy weights) is what the frame is moved by before it is learnt.

use super::grid::NONE;
use super::ledger::{Ledger, Word};
use super::places::Places;
use crate::math::camera::Camera;
use crate::math::cholesky::Cholesky;
use crate::math::pose::Pose;
use crate::model::scene::sums::{SceneSums, outer};
use crate::observation::surface::{Observation, SurfacePoint};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

/// Every so-many-th point of a frame is looked at: neighbours say the same.
pub const EVERY: usize = 4;
/// Fewest points of a component that is trusted as a plane.
const LEAST_POINTS: f64 = 20.0;
/// Fewest points of those looked at in it.
const LEAST_OWNED: usize = 2;
/// Least length of the mean normal of a plane.
const LEAST_AGREEMENT: f64 = 0.8;
/// Fewest components that determine a motion.
const LEAST_COMPONENTS: usize = 500;
/// Points of a component at which its residual counts in full.
const FULL_POINTS: f64 = 3.0;
/// Neighbouring components err together: so many count as one.
const ALIKE: f64 = 100.0;
/// Variance of a component's mean colour from frame to frame.
const COLOR_VARIANCE: f64 = 0.01;
/// Squared residual, in its variances, at which Cauchy's weight is a half.
const ROBUST: f64 = 4.0;
/// Standard deviation of a recorded orientation, radians.
const TURN_DEVIATION: f64 = 0.01;
/// Gauss–Newton steps.
const ROUNDS: usize = 3;

/// Scene and frame as they are before the frame is learnt.
pub struct Alignment<'a, W> {
    /// Sums of the components.
    pub ledger: &'a Ledger<W>,
    /// Where they stand.
    pub places: Places<'a>,
    /// Structural scale, world units.
    pub h: f64,
    /// Ridge of the regression of colour on position, world units².
    pub ridge: f64,
    /// The frame as recorded.
    pub frame: &'a Observation,
    /// Those of its points that are looked at.
    pub points: &'a [SurfacePoint],
    /// Component of each of them.
    pub owners: &'a [u32],
    /// Factors that bring its colours to the scene's exposure.
    pub gain: [f32; 3],
}

/// Small motion of a camera and of what it saw, in the world's axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Turn about the camera's centre.
    pub turn: DQuat,
    /// Shift after it, world units.
    pub shift: DVec3,
}

/// What a component expects of the frame, and what the frame shows of it.
struct Match {
    normal: DVec3,
    /// Variance of the points' mean along the normal, world units².
    variance: f64,
    /// Mean of the component, world units from the origin.
    mean: DVec3,
    color: DVec3,
    /// Row per channel, in the plane.
    gradient: DMat3,
    /// Means of the frame's points.
    seen: DVec3,
    seen_color: DVec3,
    weight: f64,
}

impl<W: Word> Alignment<'_, W> {
    /// The frame's motion; `None` where too little of the scene is known.
    pub fn motion(&self) -> Option<Motion> {
        let matches = self.matches();
        if matches.len() < LEAST_COMPONENTS {
            return None;
        }
        let centre = self.frame.camera.pose.centre() - self.frame.origin;
        let shift_deviation = f64::from(self.frame.tolerance.refinement);
        let mut motion = Motion { turn: DQuat::IDENTITY, shift: DVec3::ZERO };
        for _ in 0..ROUNDS {
            let mut normal = Normal::prior(&motion, shift_deviation);
            matches.iter().for_each(|matched| normal.add_match(matched, centre, &motion));
            let [turn, shift] = normal.solution()?;
            motion.turn = (DQuat::from_scaled_axis(turn) * motion.turn).normalize();
            motion.shift += shift;
        }
        Some(motion)
    }

    /// Of the components that own enough points, in ascending order.
    fn matches(&self) -> Vec<Match> {
        let known = |owner: u32| owner != NONE && (owner as usize) < self.ledger.len();
        let owners = self.owners.iter().enumerate().filter(|(_, owner)| known(**owner));
        let mut order: Vec<u64> =
            owners.map(|(i, &owner)| u64::from(owner) << 32 | i as u64).collect();
        order.par_sort_unstable();
        let runs: Vec<&[u64]> = order.chunk_by(|a, b| a >> 32 == b >> 32).collect();
        let runs = runs.par_iter().with_min_len(64);
        runs.filter(|run| run.len() >= LEAST_OWNED).filter_map(|run| self.matched(run)).collect()
    }

    /// What the points of one component say; keys hold the component above the point.
    fn matched(&self, run: &[u64]) -> Option<Match> {
        let id = (run[0] >> 32) as usize;
        let sums = SceneSums::new(&self.ledger.sums(id), self.h);
        let normal = sums.normal / sums.count;
        if sums.count < LEAST_POINTS || normal.length() < LEAST_AGREEMENT {
            return None;
        }
        let normal = normal.normalize();
        let seed = vector(self.places.of(id));
        let n = run.len() as f64;
        let (mut seen, mut seen_color, mut noise) = (DVec3::ZERO, DVec3::ZERO, 0.0);
        for key in run {
            let point = &self.points[*key as u32 as usize];
            seen += (point.position_vector() - seed) / n;
            seen_color += self.exposed(point) / n;
            noise += f64::from(point.noise) / n;
        }
        let gradient = sums.gradient(self.ridge);
        Some(Match {
            normal,
            variance: noise * noise + sums.covariance().quadratic_form(normal).max(0.0),
            mean: seed + sums.mean_offset(),
            color: sums.color / sums.count,
            gradient: gradient - outer(gradient * normal, normal),
            seen: seed + seen,
            seen_color,
            weight: (n / FULL_POINTS).min(1.0),
        })
    }

    fn exposed(&self, point: &SurfacePoint) -> DVec3 {
        vector([0, 1, 2].map(|i| (point.color[i] * self.gain[i]).min(1.0)))
    }
}

/// Normal equations of turn and shift.
struct Normal {
    /// Row by row; the lower triangle.
    matrix: [f64; 36],
    right: [f64; 6],
}

impl Normal {
    /// What the recorded pose says.
    fn prior(motion: &Motion, shift_deviation: f64) -> Self {
        let mut normal = Self { matrix: [0.0; 36], right: [0.0; 6] };
        let turn = motion.turn.to_scaled_axis();
        for axis in 0..3 {
            for (i, value, deviation) in [
                (axis, turn[axis], TURN_DEVIATION),
                (axis + 3, motion.shift[axis], shift_deviation),
            ] {
                normal.matrix[7 * i] = deviation.powi(-2);
                normal.right[i] = -value * deviation.powi(-2);
            }
        }
        normal
    }

    fn add_match(&mut self, matched: &Match, centre: DVec3, motion: &Motion) {
        let arm = motion.turn * (matched.seen - centre);
        let offset = centre + arm + motion.shift - matched.mean;
        let distance = matched.normal.dot(offset);
        let weight = matched.weight / (ALIKE * matched.variance);
        let trust = 1.0 / (1.0 + distance * distance / (matched.variance * ROBUST));
        self.add(distance, matched.normal, arm, weight * trust);
        let color = matched.seen_color - matched.color - matched.gradient * offset;
        let weight = matched.weight / (ALIKE * COLOR_VARIANCE);
        let trust = 1.0 / (1.0 + color.length_squared() / (COLOR_VARIANCE * ROBUST));
        let rows = matched.gradient.transpose();
        for channel in 0..3 {
            self.add(color[channel], -rows.col(channel), arm, weight * trust);
        }
    }

    /// Adds a residual that changes by `slope` with the position of what lies at `arm` from the
    /// camera.
    fn add(&mut self, residual: f64, slope: DVec3, arm: DVec3, weight: f64) {
        let turn = arm.cross(slope);
        let row = [turn.x, turn.y, turn.z, slope.x, slope.y, slope.z];
        for i in 0..6 {
            self.right[i] -= weight * residual * row[i];
            for j in 0..=i {
                self.matrix[6 * i + j] += weight * row[i] * row[j];
            }
        }
    }

    /// Turn (axis times angle) and shift; `None` unless all numbers are finite.
    fn solution(&self) -> Option<[DVec3; 2]> {
        let x = Cholesky::new(6, &self.matrix)?.solve(&self.right);
        let [turn, shift] = [DVec3::from_slice(&x[..3]), DVec3::from_slice(&x[3..])];
        (turn.is_finite() && shift.is_finite()).then_some([turn, shift])
    }
}

impl Motion {
    /// Moves the frame's points into `points` and returns its camera, moved likewise.
    pub fn apply(&self, frame: &Observation, points: &mut Vec<SurfacePoint>) -> Camera {
        let Camera { intrinsics, pose } = frame.camera;
        let turn = DMat3::from_quat(self.turn);
        let centre = pose.centre() - frame.origin;
        let moved = |point: &SurfacePoint| SurfacePoint {
            position: array(centre + turn * (point.position_vector() - centre) + self.shift),
            normal: array(turn * point.normal_vector()),
            direction: array(turn * point.direction_vector()),
            ..*point
        };
        frame.points.par_iter().with_min_len(1024).map(moved).collect_into_vec(points);
        Camera { intrinsics, pose: self.of_pose(&pose) }
    }

    fn of_pose(&self, pose: &Pose) -> Pose {
        let world_from_camera = DQuat::from_mat3(&pose.rotation());
        let turn = world_from_camera.inverse() * self.turn * world_from_camera;
        pose.attached(world_from_camera.inverse() * self.shift, turn)
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

fn array(v: DVec3) -> [f32; 3] {
    v.as_vec3().to_array()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::{Purpose, Rng};
    use crate::train::scene::config::SceneConfig;
    use crate::train::scene::trainer::SceneTrainer;

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
                position: array(position),
                range: 1.4,
                color: array(color),
                noise: 0.003,
                normal: array(normal),
                footprint: 0.01,
                direction: array(position.normalize()),
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
            assert!((moved.position_vector() - right.position_vector()).length() < 1e-3);
            assert!((moved.normal_vector() - right.normal_vector()).length() < 1e-3);
        }
    }

    #[test]
    fn an_unknown_scene_moves_nothing() {
        let mut trainer = SceneTrainer::<f64>::new(&SceneConfig::coarse(0.05), DVec3::ZERO);
        assert_eq!(trainer.motion(&room(DQuat::IDENTITY, DVec3::ZERO)), None);
    }
}
