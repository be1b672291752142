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

/// Matches of one part of the components, in the order of each component's first point.
struct PartMatches<'p> {
    matches: Vec<Match<'p>>,
    /// First point of each match, and distance of its mean position from the camera, world units.
    firsts: Vec<(u32, f64)>,
    /// Number of points of all matches.
    n_points: f64,
}

struct FrameMatches<'p> {
    parts: Vec<PartMatches<'p>>,
    /// Part and number in the part of each match, in the order of each component's first point.
    order: Vec<[u32; 2]>,
    /// Sum of the distances of the matches from the camera, world units.
    summed_reach: f64,
    /// Share of the frame's points that belong to the matched components, 0 to 1.
    share: f64,
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
    const STRIDE: usize = GROUP_STRIDE * GROUP;
    let n = frame.points.len();
    // Only the last group can lack points.
    let n_chosen = n / STRIDE * GROUP + (n % STRIDE).min(GROUP);
    let chosen = (0..n_chosen).into_par_iter().with_min_len(512);
    let point = |i: usize| frame.points[i / GROUP * STRIDE + i % GROUP];
    with_points(frame, chosen.map(point).collect())
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
        let centre = self.frame.camera.pose.centre() - self.frame.origin;
        let found = self.matches(planes, centre);
        let deviations = [TURN_DEVIATION, f64::from(self.frame.tolerance.place)];
        let motion = found.step(before, centre, deviations)?;
        let turned = (motion.turn * before.turn.inverse()).to_scaled_axis().length();
        // A rotation moves a point in proportion to its distance from the camera.
        let reach = found.summed_reach;
        let moved =
            (motion.shift - before.shift).length() + turned * reach / found.order.len() as f64;
        Some(Improvement { motion, has_converged: moved < CONVERGED * self.h })
    }

    /// Returns the means of the frame's points in each component. Every component is summed by one thread, in the
    /// order of the points, so that rounding depends neither on the machine nor on the numbering of components.
    /// `centre` is the camera's position, world units from the origin.
    fn matches<'p>(&self, planes: &'p mut KnownPlanes<'_>, centre: DVec3) -> FrameMatches<'p> {
        // A power of two, since a division for every point and part would take longer than the sums.
        let (source, bits) = (planes.source, planes.parts.len().ilog2());
        let parts = (0u32..1 << bits).into_par_iter().zip(&mut planes.parts).with_max_len(1);
        let parts = parts.map(|(number, part)| {
            let own = (0u32..)
                .zip(self.owners)
                .filter(|(_, owner)| **owner & ((1 << bits) - 1) == number);
            let points: Vec<u32> = own.map(|(point, _)| point).collect();
            let places: Vec<u32> = points
                .iter()
                .map(|point| part.place(self.owners[*point as usize] as usize, bits, source))
                .collect();
            self.part_matches(points, places, part, centre)
        });
        FrameMatches::new(parts.collect(), self.frame.points.len())
    }

    fn part_matches<'p>(
        &self,
        points: Vec<u32>,
        places: Vec<u32>,
        part: &'p PlanePart,
        centre: DVec3,
    ) -> PartMatches<'p> {
        let mut at = vec![NONE; part.planes.len()];
        let mut sums: Vec<(f64, Match<'p>)> = Vec::new();
        let mut firsts = Vec::new();
        for (number, place) in points.into_iter().zip(places) {
            let Some(Some(plane)) = part.planes.get(place as usize) else { continue };
            let at = &mut at[place as usize];
            if *at == NONE {
                *at = sums.len() as u32;
                let (position, color) = (DVec3::ZERO, DVec3::ZERO);
                sums.push((0.0, Match { plane, position, color, noise: 0.0 }));
                firsts.push(number);
            }
            let (n, matched) = &mut sums[*at as usize];
            let point = &self.frame.points[number as usize];
            *n += 1.0;
            // About the seed, so that the mean keeps its digits far from the origin.
            matched.position += point.position_vector() - plane.seed;
            matched.color += self.exposed(point);
            matched.noise += f64::from(point.noise);
        }
        let n_points = sums.iter().map(|(n, _)| n).sum();
        let matches: Vec<Match<'p>> =
            sums.into_iter().map(|(n, matched)| matched.mean_of(n)).collect();
        let lengths = matches.iter().map(|matched| (matched.position - centre).length());
        PartMatches { firsts: firsts.into_iter().zip(lengths).collect(), matches, n_points }
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

impl<'p> FrameMatches<'p> {
    fn new(parts: Vec<PartMatches<'p>>, n_points: usize) -> Self {
        let mut by_first = vec![None; n_points];
        for (part, matches) in (0..).zip(&parts) {
            for (number, &(first, length)) in (0..).zip(&matches.firsts) {
                by_first[first as usize] = Some(([part, number], length));
            }
        }
        let (order, lengths): (Vec<_>, Vec<f64>) = by_first.into_iter().flatten().unzip();
        let summed_reach = lengths.iter().sum();
        let owned: f64 = parts.iter().map(|part| part.n_points).sum();
        // A frame without points must not give a share of NaN.
        let share = owned / n_points.max(1) as f64;
        Self { parts, order, summed_reach, share }
    }

    /// Returns how many neighbouring matches count as one independent match, since their errors
    /// correlate. The number is smaller if components are few and large.
    fn n_correlated(&self) -> f64 {
        (self.order.len() as f64 / (PATCHES * self.share)).clamp(1.0, MAX_CORRELATED)
    }

    /// Returns the factor on the prior deviation of the recorded position, below 1 for few components.
    /// Few, large components describe texture badly. Their errors would move the camera along a wall
    /// that does not constrain such motion.
    fn prior_factor(&self) -> f64 {
        (self.order.len() as f64 / MANY_COMPONENTS).powi(2).clamp(HELD, 1.0)
    }

    /// Returns a more probable motion than `before` for a camera recorded at `centre`, world units from
    /// the origin. `turn` and `shift` are the prior standard deviations of rotation (radians) and
    /// position (world units). `None` if there are too few matches.
    fn step(&self, before: &Motion, centre: DVec3, [turn, shift]: [f64; 2]) -> Option<Motion> {
        if self.order.len() < MIN_COMPONENTS {
            return None;
        }
        let alike = self.n_correlated();
        let deviations = [turn, shift * self.prior_factor()];
        let mut motion = *before;
        for _ in 0..STEPS {
            // The prior stays about the recorded pose: about the last motion, rounds could drift away.
            let mut normal = RigidEquations::prior(&motion, deviations);
            let part = |order: &[[u32; 2]]| {
                let mut part = RigidEquations::NONE;
                for &[of, number] in order {
                    let matched = &self.parts[of as usize].matches[number as usize];
                    part.add_match(matched, centre, &motion, alike);
                }
                part
            };
            // Parts of fixed size, added in order: rounding is independent of the number of threads.
            let parts: Vec<_> = self.order.par_chunks(PART).map(part).collect();
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
    source: PlaneSource<'a>,
    /// Components whose numbers have the same remainder, one part for each remainder.
    parts: Vec<PlanePart>,
}

/// Scene from which planes are computed.
#[derive(Clone, Copy)]
struct PlaneSource<'a> {
    component_sums: &'a ComponentSums,
    seeds: &'a Seeds,
    h: f64,
    /// Ridge of the regression of colour on position, world units².
    ridge: f64,
}

/// Planes of one part of the components. Neighbouring components, which are seen together, are in different parts.
#[derive(Default)]
struct PlanePart {
    /// Index in `planes` of each of the part's components, or [`NONE`]; empty before the first one is needed.
    places: Vec<u32>,
    planes: Vec<Option<ColoredPlane>>,
}

impl<'a> KnownPlanes<'a> {
    pub fn new(component_sums: &'a ComponentSums, seeds: &'a Seeds, h: f64, ridge: f64) -> Self {
        // More than threads, so that a delayed thread is left less to do.
        let n_parts = (2 * rayon::current_num_threads()).next_power_of_two();
        let mut parts = Vec::new();
        parts.resize_with(n_parts, PlanePart::default);
        Self { source: PlaneSource { component_sums, seeds, h, ridge }, parts }
    }
}

impl PlanePart {
    /// Returns the index of a component's plane in `planes`, and computes the plane if it is not in the cache.
    /// `bits` is the logarithm
    /// to base 2 of the number of parts. [`NONE`] for components created in this frame and for points without one.
    fn place(&mut self, component: usize, bits: u32, source: PlaneSource<'_>) -> u32 {
        let PlaneSource { component_sums, seeds, h, ridge } = source;
        if component >= component_sums.len() {
            return NONE;
        }
        if self.places.is_empty() {
            self.places.resize(component_sums.len().div_ceil(1 << bits), NONE);
        }
        let place = &mut self.places[component >> bits];
        if *place == NONE {
            *place = self.planes.len() as u32;
            let sums = SceneSums::new(&component_sums.sums(component), h);
            let seed = DVec3::from_array(seeds.of(component).map(f64::from));
            self.planes.push(ColoredPlane::new(&sums, seed, ridge));
        }
        *place
    }
}
