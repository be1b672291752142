//! Alignment of a frame's pose to the scene: recorded poses of real cameras err by more than the structural
//! scale.
//!
//! Every known component gives two constraints on its points in the frame. The points lie in the
//! component's plane, and their mean colour follows the component's joint Gaussian of position and
//! colour. Before the frame is added to the scene, it is moved by a small camera motion. The motion is
//! the most probable one under both constraints and a prior about the recorded pose. It is found by
//! Gauss–Newton steps with Cauchy weights (MAP).
//!
//! Errors of neighbouring components correlate, so their evidence is divided by the number of
//! components that are correlated. Otherwise thousands of components would always outweigh the prior.
//! Planes alone leave motion along a wall undetermined; colours determine it. Motion determined by
//! neither stays as recorded.
//!
//! A component describes colours only within its extent. So every round assigns the moved points to
//! components anew, and takes only a part of the computed step. Pose errors are similar from frame to
//! frame, so the first round starts at the correction of nearby frames. Typically there are six rounds
//! with a subset of the points, then one with all points. Exact poses are not aligned.

use super::component_sums::{ComponentSums, KNOWN_POINTS};
use super::components::Seeds;
use super::grid::NONE;
use super::rigid_equations::{Motion, RigidEquations};
use super::seed_groups::GROUP;
use crate::model::scene::sums::{SceneSums, outer};
use crate::observation::surface::{Observation, SurfacePoint};
use glam::{DMat3, DQuat, DVec3};
use rayon::prelude::*;

// Approximate number of points used per frame: neighbours are redundant.
const MAX_USED: usize = 8192;
/// Stride over groups of neighbouring points, used until the pose has nearly converged (`scene.md`, Pose
/// alignment).
pub const GROUP_STRIDE: usize = 4;
/// Maximum number of rounds. Each round assigns the points to components and takes Gauss–Newton steps.
pub const ROUNDS: usize = 24;
/// Mean movement of a point in a round, in units of the structural scale, below which the pose has
/// converged.
const CONVERGED: f64 = 0.02;
/// Minimum number of matched components for the estimate of a motion.
// A rigid motion has six unknowns, and a plane constrains one.
const MIN_COMPONENTS: usize = 6;
/// Minimum number of matched components at which the prior deviation of the recorded position is not
/// reduced.
const MANY_COMPONENTS: f64 = 500.0;
// Maximum number of neighbouring components that count as one, since their errors correlate.
const MAX_CORRELATED: f64 = 10.0;
/// Minimum number of patches with independent errors in a whole picture.
const PATCHES: f64 = MANY_COMPONENTS / MAX_CORRELATED;
/// Smallest factor by which the prior deviation of the recorded position is reduced, used for few
/// matched components.
const HELD: f64 = 0.3;
/// Variance of a component's mean colour between frames.
const COLOR_VARIANCE: f64 = 0.003;
/// Squared residual, in units of its variance, at which the Cauchy weight is one half.
const ROBUST: f64 = 4.0;
/// Standard deviation of a recorded orientation, radians.
pub const TURN_DEVIATION: f64 = 0.01;
/// Number of Gauss–Newton steps per assignment of points to components.
const STEPS: usize = 2;
const PART: usize = 256;

pub struct PoseAlignment<'a> {
    /// Frame as recorded, with the points selected by [`alignment_subset`].
    pub frame: &'a Observation,
    /// Component of each point under the current motion.
    pub owners: &'a [u32],
    /// Factor per channel that converts the frame's colours to the scene's exposure.
    pub gain: [f32; 3],
    pub h: f64,
}

/// A component of the scene, with the means of the frame's points that belong to it.
struct Match<'p> {
    pub plane: &'p ColoredPlane,
    /// Mean position of the frame's points under the recorded pose, world units from the scene's origin.
    pub position: DVec3,
    /// Mean colour of the frame's points, in the scene's exposure.
    pub color: DVec3,
    /// Mean half-width of the depth noise of the frame's points, world units.
    pub noise: f64,
}

pub struct Improvement {
    pub motion: Motion,
    pub has_converged: bool,
}

struct FrameMatches<'p> {
    pub matches: Vec<Match<'p>>,
    /// Share of the frame's points that belong to the matched components, 0 to 1.
    pub share: f64,
}

/// Returns the frame with an evenly spaced subset of its points for alignment.
pub fn alignment_subset(frame: &Observation) -> Observation {
    let every = (frame.points.len() / MAX_USED).max(1);
    // Parallel: the points are far apart in memory and were just written by another core.
    let chosen = (0..frame.points.len().div_ceil(every)).into_par_iter().with_min_len(512);
    with_points(frame, chosen.map(|i| frame.points[i * every]).collect())
}

/// Returns the frame with one of every [`GROUP_STRIDE`] groups of points. A group consists of
/// neighbouring points, whose seeds are searched for together.
pub fn first_groups(frame: &Observation) -> Observation {
    let groups = frame.points.chunks(GROUP).step_by(GROUP_STRIDE);
    with_points(frame, groups.flatten().copied().collect())
}

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
    /// Returns a more probable motion of the frame than `before`. `owners` must have been assigned under
    /// `before`. `None` if too few components are known.
    pub fn improve(&self, before: &Motion, planes: &mut KnownPlanes<'_>) -> Option<Improvement> {
        let found = self.matches(planes);
        let centre = self.frame.camera.pose.centre() - self.frame.origin;
        let deviations = [TURN_DEVIATION, f64::from(self.frame.tolerance.place)];
        let motion = found.step(before, centre, deviations)?;
        let matches = &found.matches;
        let reach = matches.iter().map(|m| (m.position - centre).length()).sum::<f64>();
        let turned = (motion.turn * before.turn.inverse()).to_scaled_axis().length();
        // A rotation moves a point in proportion to its distance from the camera.
        let moved = (motion.shift - before.shift).length() + turned * reach / matches.len() as f64;
        Some(Improvement { motion, has_converged: moved < CONVERGED * self.h })
    }

    /// Returns the means of the frame's points in each component, in the order of each component's first
    /// point. Runs on one thread, so that rounding depends neither on the machine nor on the numbering
    /// of components.
    fn matches<'p>(&self, planes: &'p mut KnownPlanes<'_>) -> FrameMatches<'p> {
        planes.compute_missing(self.owners);
        let planes = &*planes;
        let mut at = vec![NONE; planes.len()];
        let mut sums: Vec<(f64, Match<'p>)> = Vec::new();
        for (point, &component) in self.frame.points.iter().zip(self.owners) {
            let Some((number, plane)) = planes.plane_of(component) else { continue };
            if at[number] == NONE {
                at[number] = sums.len() as u32;
                let (position, color) = (DVec3::ZERO, DVec3::ZERO);
                sums.push((0.0, Match { plane, position, color, noise: 0.0 }));
            }
            let (n, matched) = &mut sums[at[number] as usize];
            *n += 1.0;
            // About the seed, so that the mean keeps its digits far from the origin.
            matched.position += point.position_vector() - plane.seed;
            matched.color += self.exposed(point);
            matched.noise += f64::from(point.noise);
        }
        let owned: f64 = sums.iter().map(|(n, _)| n).sum();
        // A frame without points must not give a share of NaN.
        let share = owned / self.frame.points.len().max(1) as f64;
        let matches = sums.into_iter().map(|(n, matched)| matched.mean_of(n)).collect();
        FrameMatches { matches, share }
    }

    fn exposed(&self, point: &SurfacePoint) -> DVec3 {
        // As in the sums: a gain must not lift a colour above 1.
        vector([0, 1, 2].map(|i| (point.color[i] * self.gain[i]).min(1.0)))
    }
}

impl Match<'_> {
    /// Converts sums over `n` points to means. Positions are summed relative to the component's seed.
    fn mean_of(self, n: f64) -> Self {
        let Self { plane, position, color, noise } = self;
        Self { plane, position: plane.seed + position / n, color: color / n, noise: noise / n }
    }
}

impl FrameMatches<'_> {
    /// Returns how many neighbouring matches count as one independent match, since their errors
    /// correlate. The number is smaller if components are few and large.
    fn n_correlated(&self) -> f64 {
        (self.matches.len() as f64 / (PATCHES * self.share)).clamp(1.0, MAX_CORRELATED)
    }

    /// Returns the factor on the prior deviation of the recorded position, below 1 for few components.
    /// Few, large components describe texture badly. Their errors would move the camera along a wall
    /// that does not constrain such motion.
    fn prior_factor(&self) -> f64 {
        (self.matches.len() as f64 / MANY_COMPONENTS).powi(2).clamp(HELD, 1.0)
    }

    /// Returns a more probable motion than `before` for a camera recorded at `centre`, world units from
    /// the origin. `turn` and `shift` are the prior standard deviations of rotation (radians) and
    /// position (world units). `None` if there are too few matches.
    fn step(&self, before: &Motion, centre: DVec3, [turn, shift]: [f64; 2]) -> Option<Motion> {
        let matches = &self.matches;
        if matches.len() < MIN_COMPONENTS {
            return None;
        }
        let alike = self.n_correlated();
        let deviations = [turn, shift * self.prior_factor()];
        let mut motion = *before;
        for _ in 0..STEPS {
            // The prior stays about the recorded pose: about the last motion, rounds could drift away.
            let mut normal = RigidEquations::prior(&motion, deviations);
            let part = |matches: &[Match<'_>]| {
                let mut part = RigidEquations::NONE;
                matches.iter().for_each(|matched| part.add_match(matched, centre, &motion, alike));
                part
            };
            // Parts of fixed size, added in order: rounding is independent of the number of threads.
            let parts: Vec<_> = matches.par_chunks(PART).map(part).collect();
            parts.iter().for_each(|part| normal.add_equations(part));
            let [turn, shift] = normal.solution()?;
            motion.turn = (DQuat::from_scaled_axis(turn) * motion.turn).normalize();
            motion.shift += shift;
        }
        Some(motion)
    }
}

impl RigidEquations {
    fn add_match(&mut self, matched: &Match<'_>, centre: DVec3, motion: &Motion, alike: f64) {
        let Match { plane, position, color, noise } = matched;
        // Rotates about the camera centre, so that a rotation leaves the camera's position unchanged.
        let arm = motion.turn * (*position - centre);
        let offset = centre + arm + motion.shift - plane.mean;
        let distance = plane.normal.dot(offset);
        // Not divided by the number of points: errors of neighbouring pixels do not average out.
        let variance = noise * noise + plane.variance;
        let weight = 1.0 / (alike * variance);
        // Cauchy weight: points of another surface lose influence with distance.
        let trust = 1.0 / (1.0 + distance * distance / (variance * ROBUST));
        let across = weight * trust * plane.normal;
        let color = *color - plane.color - plane.gradient * offset;
        let weight = 1.0 / (alike * COLOR_VARIANCE);
        let trust = 1.0 / (1.0 + color.length_squared() / (COLOR_VARIANCE * ROBUST));
        let along = weight * trust * plane.gradient.transpose();
        // Plane and channels are combined, as all of them share one lever arm.
        let information = outer(across, plane.normal) + along * plane.gradient;
        self.add_all(information, distance * across - along * color, arm);
    }
}

fn vector(v: [f32; 3]) -> DVec3 {
    DVec3::from_array(v.map(f64::from))
}

/// Minimum length of the mean of a component's unit normals, for the component to be treated as a
/// plane.
const MIN_AGREEMENT: f64 = 0.8;

/// A component as a plane whose colour changes linearly with position.
#[derive(Clone, Copy)]
pub struct ColoredPlane {
    /// Seed from which the component's sums measure offsets, world units from the origin.
    pub seed: DVec3,
    /// Mean of the component's points, world units from the origin.
    pub mean: DVec3,
    pub normal: DVec3,
    /// Variance of the component's points along the normal, world units².
    pub variance: f64,
    pub color: DVec3,
    /// Colour gradient within the plane, one row per channel, per world unit.
    pub gradient: DMat3,
}

impl ColoredPlane {
    /// Fits a plane to the sums of a component with the given seed. `ridge` (world units²) regularises
    /// the colour gradient. `None` if there are few points or the normals diverge.
    pub fn new(sums: &SceneSums, seed: DVec3, ridge: f64) -> Option<Self> {
        let normal = sums.normal / sums.count;
        if sums.count < KNOWN_POINTS || normal.length() < MIN_AGREEMENT {
            return None;
        }
        let normal = normal.normalize();
        let covariance = sums.covariance();
        let gradient = sums.gradient(covariance, ridge);
        Some(Self {
            seed,
            mean: seed + sums.mean_offset(),
            normal,
            // Rounding can make the variance across a flat component negative.
            variance: covariance.quadratic_form(normal).max(0.0),
            color: sums.color / sums.count,
            // The points give no information on the colour across the plane, so that part is removed.
            gradient: gradient - outer(gradient * normal, normal),
        })
    }
}

/// Cache of the planes of those components that a frame uses.
pub struct KnownPlanes<'a> {
    component_sums: &'a ComponentSums,
    seeds: &'a Seeds,
    h: f64,
    /// Ridge of the regression of colour on position, world units².
    ridge: f64,
    /// Index of each component's plane in `planes`.
    places: Vec<u32>,
    planes: Vec<Option<ColoredPlane>>,
}

impl<'a> KnownPlanes<'a> {
    pub fn new(component_sums: &'a ComponentSums, seeds: &'a Seeds, h: f64, ridge: f64) -> Self {
        let places = vec![NONE; component_sums.len()];
        Self { component_sums, seeds, h, ridge, places, planes: Vec::new() }
    }

    /// Computes the planes of the given components that are not in the cache. Components created in this
    /// frame are skipped.
    pub fn compute_missing(&mut self, owners: &[u32]) {
        let mut new = Vec::new();
        for &id in owners {
            if let Some(place) = self.places.get_mut(id as usize).filter(|place| **place == NONE) {
                *place = (self.planes.len() + new.len()) as u32;
                new.push(id);
            }
        }
        let plane = |&id: &u32| {
            let sums = SceneSums::new(&self.component_sums.sums(id as usize), self.h);
            let seed = DVec3::from_array(self.seeds.of(id as usize).map(f64::from));
            ColoredPlane::new(&sums, seed, self.ridge)
        };
        // Keeps the order of `new`, which the places refer to.
        self.planes.par_extend(new.par_iter().with_min_len(64).map(plane));
    }

    pub fn len(&self) -> usize {
        self.planes.len()
    }

    /// Returns index and plane of a component that was passed to [`Self::compute_missing`]; `None` if it
    /// has no plane.
    #[inline]
    pub fn plane_of(&self, component: u32) -> Option<(usize, &ColoredPlane)> {
        let place = *self.places.get(component as usize)? as usize;
        Some((place, self.planes.get(place)?.as_ref()?))
    }
}
