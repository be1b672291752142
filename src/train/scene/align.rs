//! Where a frame's camera stood, given the scene: recorded poses of real cameras err by more than
//! the structural scale.
//!
//! Every component that is known already says two things of the frame's points it owns: they lie in
//! its plane, and their mean colour is that of its joint Gaussian of position and colour there. The
//! most probable small motion of the camera under both and under a prior about the recorded pose
//! (MAP, Gauss–Newton with Cauchy weights) is what the frame is moved by before it is learnt.
//!
//! Neighbouring components err together, so their evidence is divided by how many count as one:
//! else thousands of them would outweigh the prior, whatever they say. Planes alone leave motions
//! along a wall free; colours hold those. What neither determines stays as recorded.
//!
//! A component tells of colours no farther than it reaches, so every round searches the components of
//! the moved points anew and goes a part of the way. Cameras err alike from frame to frame, so the first
//! round begins where the frames around say; six rounds of a few points are usual, and one of all from
//! there. Exact poses are left alone.

use super::grid::NONE;
use super::known_planes::{ColoredPlane, KnownPlanes};
use super::near_seeds::GROUP;
use super::rigid_equations::{Motion, RigidEquations};
use super::sum_scalar::SumScalar;
use crate::model::scene::kept::Shown;
use crate::model::scene::sums::outer;
use crate::observation::surface::{Observation, SurfacePoint};
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Points of a frame that are looked at, about: neighbours say the same.
const LOOKED_AT: usize = 8192;
/// Of so many groups of neighbours among them, one leads most of the way (`scene.md`, Pose alignment).
pub const FEW: usize = 4;
/// Searches for components and motions at most, one after the other.
pub const ROUNDS: usize = 24;
/// Movement of a point in a round, units of the structural scale, from which on another is of use.
const SETTLED: f64 = 0.02;
/// Fewest components that determine a motion.
const MIN_COMPONENTS: usize = 6;
/// Components from which on a motion is free within the whole prior.
const MANY_COMPONENTS: f64 = 500.0;
/// Neighbouring components that count as one, at most, since their errors correlate.
const ALIKE: f64 = 10.0;
/// Patches of a whole picture whose errors do not correlate, at least.
const PATCHES: f64 = MANY_COMPONENTS / ALIKE;
/// Share of the deviation of a recorded place that the prior has where components are few.
const HELD: f64 = 0.3;
/// Variance of a component's mean colour from frame to frame.
const COLOR_VARIANCE: f64 = 0.003;
/// Squared residual, in its variances, at which Cauchy's weight is a half.
const ROBUST: f64 = 4.0;
/// Standard deviation of a recorded orientation, radians.
pub const TURN_DEVIATION: f64 = 0.01;
/// Gauss–Newton steps for one choice of components.
const STEPS: usize = 2;
/// Matches of one partial sum.
const PART: usize = 256;

/// A frame before it is learnt, beside what the scene says of where it is.
pub struct PoseAlignment<'a> {
    /// The frame as recorded, with as many of its points as are [`looked_at`].
    pub frame: &'a Observation,
    /// Component of each of the points where the motion so far takes them.
    pub owners: &'a [u32],
    /// Factors that bring its colours to the scene's exposure.
    pub gain: [f32; 3],
    /// Structural scale, world units.
    pub h: f64,
}

/// What a component expects of the frame, and what the frame shows of it.
pub struct Match<'p> {
    /// What it expects.
    pub plane: &'p ColoredPlane,
    /// What the frame shows.
    pub shown: Shown,
}

/// What a round of searching and stepping led to.
pub struct Improvement {
    /// A more probable motion.
    pub motion: Motion,
    /// Whether it is so near to the one before that nothing more can be gained.
    pub has_settled: bool,
    /// What the frame shows of the components that it was found by, of the last round.
    pub shown: Vec<Shown>,
}

/// Matches of a frame, and how much of it they cover.
pub struct FrameMatches<'p> {
    /// One per component.
    pub matches: Vec<Match<'p>>,
    /// Share of the frame's points that these components own, 0 to 1.
    pub share: f64,
}

/// What is known of a frame's motion before anything is seen.
#[derive(Clone, Copy)]
pub struct RecordedPose {
    /// Centre of the camera as recorded, world units from the origin.
    pub centre: DVec3,
    /// Standard deviations of turn (radians) and place (world units).
    pub deviations: [f64; 2],
}

/// A frame with as many of its points, evenly chosen, as tell of its motion.
pub fn looked_at(frame: &Observation) -> Observation {
    let every = (frame.points.len() / LOOKED_AT).max(1);
    // On all threads: points lie far apart in memory that another core has just written.
    let chosen = (0..frame.points.len().div_ceil(every)).into_par_iter().with_min_len(512);
    with_points(frame, chosen.map(|i| frame.points[i * every]).collect())
}

/// A frame with a few of its points. Neighbours stay together: they are searched for together.
pub fn a_few(frame: &Observation) -> Observation {
    let groups = frame.points.chunks(GROUP).step_by(FEW);
    with_points(frame, groups.flatten().copied().collect())
}

/// What tells where some points were seen from.
fn with_points(frame: &Observation, points: Vec<SurfacePoint>) -> Observation {
    Observation {
        points,
        camera: frame.camera,
        origin: frame.origin,
        tolerance: frame.tolerance,
        ..Observation::empty()
    }
}

impl PoseAlignment<'_> {
    /// A more probable motion than the one that the components were found with, in a round that is the last whatever
    /// it finds, or not; `None` where too little of the scene is known.
    pub fn improved<W: SumScalar>(
        &self,
        before: &Motion,
        planes: &mut KnownPlanes<'_, W>,
        is_last: bool,
    ) -> Option<Improvement> {
        let found = self.matches(planes);
        let centre = self.frame.camera.pose.centre() - self.frame.origin;
        let deviations = [TURN_DEVIATION, f64::from(self.frame.tolerance.place)];
        let motion = RecordedPose { centre, deviations }.stepped(&found, before)?;
        let matches = &found.matches;
        let reach = matches.iter().map(|m| (m.shown.place - centre).length()).sum::<f64>();
        let turned = (motion.turn * before.turn.inverse()).to_scaled_axis().length();
        let moved = (motion.shift - before.shift).length() + turned * reach / matches.len() as f64;
        let has_settled = moved < SETTLED * self.h;
        let shown = if is_last || has_settled { &matches[..] } else { &[] };
        let shown = shown.iter().map(|matched| matched.shown).collect();
        Some(Improvement { motion, has_settled, shown })
    }

    /// Matches of the components that own points, in the order in which points come upon them: on one thread, so
    /// that sums round alike on any machine, and however components are numbered.
    fn matches<'p, W: SumScalar>(&self, planes: &'p mut KnownPlanes<'_, W>) -> FrameMatches<'p> {
        planes.learn(self.owners);
        let planes = &*planes;
        let mut at = vec![NONE; planes.len()];
        let mut sums: Vec<(f64, Match<'p>)> = Vec::new();
        for (point, &component) in self.frame.points.iter().zip(self.owners) {
            let Some((number, plane)) = planes.of(component) else { continue };
            if at[number] == NONE {
                at[number] = sums.len() as u32;
                sums.push((0.0, Match { plane, shown: Shown::nothing(component) }));
            }
            let (n, Match { shown, .. }) = &mut sums[at[number] as usize];
            *n += 1.0;
            shown.place += point.position_vector() - plane.seed;
            shown.color += self.exposed(point);
            shown.noise += f64::from(point.noise);
        }
        let owned: f64 = sums.iter().map(|(n, _)| n).sum();
        let share = owned / self.frame.points.len().max(1) as f64;
        let matches = sums.into_iter().map(|(n, matched)| matched.mean_of(n)).collect();
        FrameMatches { matches, share }
    }

    fn exposed(&self, point: &SurfacePoint) -> DVec3 {
        vector([0, 1, 2].map(|i| (point.color[i] * self.gain[i]).min(1.0)))
    }
}

impl Match<'_> {
    /// Means of so many points in place of sums about the seed.
    fn mean_of(mut self, n: f64) -> Self {
        let Self { plane, shown } = &mut self;
        shown.place = plane.seed + shown.place / n;
        shown.color /= n;
        shown.noise /= n;
        self
    }
}

impl FrameMatches<'_> {
    /// Neighbouring matches that count as one: the fewer components a surface has, the larger each of them is.
    fn alike(&self) -> f64 {
        (self.matches.len() as f64 / (PATCHES * self.share)).clamp(1.0, ALIKE)
    }

    /// Share of the deviation of a recorded place that the prior has. Large components describe paint badly, and
    /// what they err by pulls a camera along a wall that does not hold it.
    fn freedom(&self) -> f64 {
        (self.matches.len() as f64 / MANY_COMPONENTS).powi(2).clamp(HELD, 1.0)
    }
}

impl RecordedPose {
    /// Returns a more probable motion than `before`; `None` with too few matches.
    pub fn stepped(&self, found: &FrameMatches<'_>, before: &Motion) -> Option<Motion> {
        let matches = &found.matches;
        if matches.len() < MIN_COMPONENTS {
            return None;
        }
        let alike = found.alike();
        let [turn, shift] = self.deviations;
        let deviations = [turn, shift * found.freedom()];
        let mut motion = *before;
        for _ in 0..STEPS {
            // About the recorded pose in every round: about the last one, rounds could wander off.
            let mut normal = RigidEquations::prior(&motion, deviations);
            let part = |matches: &[Match<'_>]| {
                let mut part = RigidEquations::NONE;
                matches
                    .iter()
                    .for_each(|matched| part.add_match(matched, self.centre, &motion, alike));
                part
            };
            // In parts of one size, added in their order: sums round alike on any number of threads.
            let parts: Vec<_> = matches.par_chunks(PART).map(part).collect();
            parts.iter().for_each(|part| normal.join(part));
            let [turn, shift] = normal.solution()?;
            motion.turn = (DQuat::from_scaled_axis(turn) * motion.turn).normalize();
            motion.shift += shift;
        }
        Some(motion)
    }
}

impl RigidEquations {
    fn add_match(&mut self, matched: &Match<'_>, centre: DVec3, motion: &Motion, alike: f64) {
        let Match { plane, shown } = matched;
        // About the camera's centre, so that a turn leaves the camera where it is.
        let arm = motion.turn * (shown.place - centre);
        let offset = centre + arm + motion.shift - plane.mean;
        let distance = plane.normal.dot(offset);
        // Not divided by the number of points: errors of neighbouring pixels do not average out.
        let variance = shown.noise * shown.noise + plane.variance;
        let weight = 1.0 / (alike * variance);
        // Cauchy's weight: what belongs to another surface pulls less the farther it is off.
        let trust = 1.0 / (1.0 + distance * distance / (variance * ROBUST));
        let across = weight * trust * plane.normal;
        let color = shown.color - plane.color - plane.gradient * offset;
        let weight = 1.0 / (alike * COLOR_VARIANCE);
        let trust = 1.0 / (1.0 + color.length_squared() / (COLOR_VARIANCE * ROBUST));
        let along = weight * trust * plane.gradient.transpose();
        // Plane and channels at once: all of them move with one arm.
        let information = outer(across, plane.normal) + along * plane.gradient;
        self.add_all(information, distance * across - along * color, arm);
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}
