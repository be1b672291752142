//! The trainer of the scene preset: owns the components and applies frames to them.
//!
//! Stages run in the order that they need (`scene.md`, Stages of a frame): a pose is corrected
//! before points look for components, births are over before anything is summed, and visibility is
//! counted with the means of after the frame.

mod budget;
mod fitting;
mod photograph;
mod posing;
mod seam;
mod second_look;
mod tracking;

use super::coarsening;
use super::component_sums::ComponentSums;
use super::components::Components;
use super::config::{SceneConfig, VisibilityRule};
use super::explain::Explainer;
use super::gain::{MIN_MATCHES, fewest_matches, gain};
use super::grid::SeedGrid;
use super::observe::observe;
use super::photometric::PhotometricLearner;
use super::point_fits::PointFits;
use super::seed_positions::SeedPositions;
use super::sum_scalar::SumScalar;
use crate::math::camera::Camera;
use crate::model::conjugate::prior::Hyper;
use crate::model::scene::kept::{KeptFrame, Shown};
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::splat_rule::{PointExtent, SplatContext};
use crate::model::scene::state::{SceneState, WHOLE, seed_order};
use crate::model::scene::sums::SceneSums;
use crate::model::scene::trajectory::TrackedPose;
use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
use crate::model::splat::exposure::{ExposureLog, FrameExposure};
use crate::model::splat::pose_log::{FramePose, PoseLog};
use crate::model::splat::splats::Splat;
use crate::observation::surface::{DepthTolerance, Observation, SurfacePoint};
use crate::train::component_elbo::ComponentElbo;
use crate::train::estep::Scoring;
use crate::train::learner::Learner;
use crate::train::outcome::{ComparedPhotograph, FrameOutcome};
use crate::train::stages::{SCENE_STAGES, SceneStage};
use crate::train::timing::{StageMs, Stopwatch};
use glam::DVec3;
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

/// Every so many frames all components are told to have changed.
const EVERYTHING_EVERY: u64 = 16;

/// Points that found no component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UnassignedPoints {
    /// The budget was used up.
    pub budget: u64,
    /// They lay too far from the origin to be told from their neighbours.
    pub reach: u64,
}

/// Components and buffers; sums are kept in words `W`.
pub struct SceneTrainer<W> {
    /// As asked for, but for a structural scale that may have grown to hold the budget.
    config: SceneConfig,
    /// The structural scale that was asked for, world units.
    scale: f64,
    /// By how many steps it has grown.
    coarsened: u32,
    origin: DVec3,
    hyper: Hyper,
    scoring: Scoring,
    grid: SeedGrid,
    components: Components,
    component_sums: ComponentSums<W>,
    /// Who finds the components of points and sums them.
    fits: PointFits,
    owners: Vec<u32>,
    shifts: Vec<f32>,
    /// Squared distance of every point of the last frame from its seed.
    q: Vec<f64>,
    component_elbo: ComponentElbo,
    touched: Vec<u32>,
    /// Whether the last frame changed components that are not among the touched.
    has_changed_all: bool,
    frames: u64,
    /// Points that found no component so far.
    unassigned: UnassignedPoints,
    /// How the frames were exposed, while gains are fitted.
    exposures: Vec<FrameExposure>,
    /// How their poses were corrected, unless these are taken for exact.
    poses: Vec<FramePose>,
    /// What the frame being learnt shows of the components that it was aligned to.
    shown: Vec<Shown>,
    /// Frames that are still to be looked at a second time, the oldest first.
    kept: VecDeque<KeptFrame>,
    /// Where the cameras of the frames were found, while poses are tracked.
    trajectory: Vec<TrackedPose>,
    /// Points of the frame being learnt as its corrected pose has them.
    moved: Vec<SurfacePoint>,
    /// What photographs taught, while splats learn from them.
    photometric: PhotometricLearner,
    /// The same once those have taught as well that wait; until the next frame.
    settled: Option<PhotometricState>,
    /// What the last frame was compared with, or what settled since.
    compared: Vec<ComparedPhotograph>,
}

impl<W: SumScalar> SceneTrainer<W> {
    /// A scene without components, whose positions are kept relative to `origin` (world units).
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        let hyper = Hyper::scene(config.h);
        let scoring = Scoring::new(&hyper);
        let grid = match config.births.is_order_invariant() {
            true => SeedGrid::of_lattice(config.h),
            false => SeedGrid::new(config.h),
        };
        Self {
            config: config.clone(),
            scale: config.h,
            coarsened: 0,
            origin,
            hyper,
            scoring,
            grid,
            components: Components::default(),
            component_sums: ComponentSums::default(),
            fits: PointFits::default(),
            owners: Vec::new(),
            shifts: Vec::new(),
            q: Vec::new(),
            component_elbo: ComponentElbo::new(scoring),
            touched: Vec::new(),
            has_changed_all: false,
            frames: 0,
            unassigned: UnassignedPoints::default(),
            exposures: Vec::new(),
            poses: Vec::new(),
            shown: Vec::new(),
            kept: VecDeque::new(),
            trajectory: Vec::new(),
            moved: Vec::new(),
            photometric: PhotometricLearner::default(),
            settled: None,
            compared: Vec::new(),
        }
    }

    /// A scene that goes on where another, configured alike, stopped after `frames` frames; `None` if
    /// its sums have another form, or seeds are farther away than their scale tells apart.
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        let h = config.h * coarsening::factor(state.coarsened);
        let mut trainer =
            Self::new(&SceneConfig { h, ..config.clone() }, DVec3::from_array(state.origin));
        (trainer.scale, trainer.coarsened) = (config.h, state.coarsened);
        trainer.component_sums = ComponentSums::restore(state.sums, state.visibility)?;
        let shares = state.shares.unwrap_or_default();
        for (i, place) in state.seeds.into_iter().enumerate() {
            if !trainer.grid.reaches(place) {
                return None;
            }
            let seed = trainer.grid.insert(place);
            trainer.components.born(seed, shares.get(i).copied().unwrap_or(WHOLE));
        }
        if let Some(components) = state.components {
            trainer.components =
                Components::restore(components, trainer.component_sums.len(), shares)?;
        }
        trainer.exposures = state.exposures;
        trainer.poses = state.poses;
        trainer.kept = state.kept.into();
        trainer.trajectory = state.trajectory;
        trainer.photometric = PhotometricLearner::restore(state.photometric.unwrap_or_default());
        let sums = &trainer.component_sums;
        trainer.photometric.observe(|id| sums.observed_cone(id));
        trainer.frames = frames;
        Some(trainer)
    }

    /// The scene as it stands, its components in their stored order.
    pub fn state(&self) -> SceneState {
        self.state_with(self.photometric.state())
    }

    fn state_with(&self, photometric: &PhotometricState) -> SceneState {
        let order = self.stored_order();
        let (sums, visibility) = self.component_sums.state(&order);
        let components = self.components.shared().map(<[u32]>::to_vec);
        let seeds = match components {
            Some(_) => (0..self.grid.len()).map(|seed| self.grid.position(seed)).collect(),
            None => order.iter().map(|&id| self.grid.position(id as usize)).collect(),
        };
        let (exposures, poses) = (self.exposures.clone(), self.poses.clone());
        let photometric = self.config.photometric.map(|_| photometric.listed(&order));
        SceneState {
            origin: self.origin.to_array(),
            coarsened: self.coarsened,
            seeds,
            shares: self.components.shares().map(<[u8]>::to_vec),
            components,
            sums,
            visibility,
            exposures,
            poses,
            trajectory: self.trajectory.clone(),
            photometric,
            kept: self.kept_in(&order),
        }
    }

    /// Frames that are kept, by the numbers of components in a stored order.
    fn kept_in(&self, order: &[u32]) -> Vec<KeptFrame> {
        if !self.config.births.is_order_invariant() {
            return self.kept.iter().cloned().collect();
        }
        let mut numbers = vec![0; order.len()];
        (0..).zip(order).for_each(|(number, &id)| numbers[id as usize] = number);
        self.kept.iter().map(|kept| kept.renumbered(&numbers)).collect()
    }

    /// Components in the order in which checkpoints hold them. Where components do not depend on the
    /// order of frames, their order does not either.
    fn stored_order(&self) -> Vec<u32> {
        let ids = 0..self.component_sums.len() as u32;
        if !self.config.births.is_order_invariant() {
            return ids.collect();
        }
        let mut seeds: Vec<_> = ids.map(|id| (self.grid.position(id as usize), id)).collect();
        // On all threads: training waits while it is saved.
        seeds.par_sort_unstable_by(|(a, _), (b, _)| seed_order(a, b));
        seeds.into_iter().map(|(_, id)| id).collect()
    }

    /// Learns from one frame, whole: nothing in it can fail.
    pub fn train(&mut self, frame: &Observation) -> FrameOutcome {
        let was_settled = self.unsettle();
        let outcome = self.learn_frame(frame);
        self.has_changed_all |= was_settled;
        outcome
    }

    fn learn_frame(&mut self, frame: &Observation) -> FrameOutcome {
        let wall = Stopwatch::start();
        let mut ms = StageMs::new(&SCENE_STAGES);
        let mut clock = Stopwatch::start();
        let mut lap = |ms: &mut StageMs, stage: SceneStage| ms.add(stage as usize, clock.lap_ms());
        let (moved, camera) = match self.placed(frame) {
            Ok(placed) => placed,
            Err(loss) => {
                lap(&mut ms, SceneStage::Pose);
                ms.train = wall.elapsed_ms();
                return self.leave_out(loss, ms);
            }
        };
        let tracking = self.tracking();
        let points = moved.as_deref().unwrap_or(&frame.points);
        lap(&mut ms, SceneStage::Pose);
        self.assign_anew(points);
        let gain = self.gain(points, frame.point_weight);
        let contradicts = self.contradicts(frame, &camera, points, gain);
        lap(&mut ms, SceneStage::Assign);
        if contradicts {
            self.touched.clear();
            self.end_frame(moved, false);
            ms.train = wall.elapsed_ms();
            return FrameOutcome { tracking, ms, ..FrameOutcome::default() };
        }
        let coarsened = self.coarsened;
        let [born, merged] = self.bear(points, |stage| lap(&mut ms, stage));
        let (n_points, elbo_mean) = self.explain(points, frame.tolerance);
        // By merging and by another scale points may have come to other components.
        let is_rebuilt = merged > 0 || self.coarsened != coarsened;
        let gain = if is_rebuilt { self.gain(points, frame.point_weight) } else { gain };
        lap(&mut ms, SceneStage::Refine);
        let taught = self.sum_up(points, frame.point_weight, gain);
        lap(&mut ms, SceneStage::Stats);
        // After the sums, so that components count the frame they were born in.
        self.see(frame, &camera);
        lap(&mut ms, SceneStage::Visibility);
        let changes = self.learn_photograph_and_look(frame, &camera, gain, taught);
        lap(&mut ms, SceneStage::Photometric);
        self.log(frame, &camera, gain);
        changes.iter().for_each(|change| self.change(change));
        let is_moved = self.hold_to_recorded(frame);
        lap(&mut ms, SceneStage::Pose);
        // Looks, merging and another scale change components without points as well.
        self.end_frame(moved, is_rebuilt || is_moved);
        ms.train = wall.elapsed_ms();
        FrameOutcome {
            points: n_points,
            evidence: n_points as u64 * u64::from(frame.point_weight),
            elbo_mean,
            born,
            reassigned: 0,
            merged,
            tracking,
            ms,
        }
    }

    /// Keeps how a frame was exposed and where it stood, as far as these were fitted.
    fn log(&mut self, frame: &Observation, camera: &Camera, gain: [f32; 3]) {
        if self.config.gain {
            self.exposures.push(FrameExposure::new(&camera.pose, gain));
        }
        if self.config.align && !self.config.track {
            self.poses.push(FramePose::new(&frame.camera.pose, &camera.pose));
        }
    }

    /// The splat of a component by its points alone.
    fn splat_of_points(&self, id: usize) -> (Splat, Appearance) {
        self.config.splat_rule.splat(&self.sums(id), &self.splat_context(id))
    }

    /// Where the points of a component are.
    fn point_extent(&self, id: usize) -> Option<PointExtent> {
        self.config.splat_rule.extent(&self.sums(id), &self.splat_context(id))
    }

    /// Counts which components the frame saw, or saw through.
    fn see(&mut self, frame: &Observation, camera: &Camera) {
        // Every frame: what is not full holds one frame more, since accumulation sums a component
        // of more than 4,096 points wide at once.
        self.component_sums.spill_to_wide_rows(&self.touched);
        if self.config.visibility == VisibilityRule::Projected {
            let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
            observe(&mut self.component_sums, seed_positions, frame, camera, self.config.h);
        }
    }

    /// Finds where points lie most probably. Gives those that have a component, and the mean of their ELBO under
    /// the initial model, as they were measured; 0 without points.
    fn explain(&mut self, points: &[SurfacePoint], tolerance: DepthTolerance) -> (usize, f64) {
        let explainer = Explainer {
            component_sums: &self.component_sums,
            seed_positions: SeedPositions { grid: &self.grid, components: &self.components },
            h: self.config.h,
            spacing: self.spacing(),
            tolerance,
            refines: self.config.refine,
        };
        let (sum, n) = explainer.explain(points, &self.owners, &mut self.q, &mut self.shifts);
        if let Some(owners) = self.component_elbo.owners() {
            owners.clone_from(&self.owners);
            self.component_elbo.count(&self.q, self.components.n_rows());
        }
        (n, if n == 0 { 0.0 } else { self.scoring.elbo(sum / n as f64) })
    }

    /// `weight` is the number of pixels that each of the points stands for.
    fn gain(&self, points: &[SurfacePoint], weight: u32) -> [f32; 3] {
        let fewest = fewest_matches(points.len(), MIN_MATCHES / f64::from(weight));
        self.gain_of(points, &self.owners, fewest)
    }

    fn gain_of(&self, points: &[SurfacePoint], owners: &[u32], fewest: f64) -> [f32; 3] {
        let (is_fitted, sums) = (self.config.gain, &self.component_sums);
        if is_fitted { gain(sums, points, owners, fewest) } else { [1.0; 3] }
    }

    /// Everything a component has received, world units about its seed.
    pub fn sums(&self, id: usize) -> SceneSums {
        SceneSums::new(&self.component_sums.sums(id), self.config.h)
    }

    /// Where a component's sums are about, world units, and the returns expected of it.
    pub fn splat_context(&self, id: usize) -> SplatContext {
        let seed = self.seed(id);
        let expected = self.component_sums.row(id).expected();
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let h = self.config.h * seed_positions.share(id);
        SplatContext { seed: self.origin + seed, h, expected, frames: self.frames }
    }

    /// Where a component's sums are about, world units from the origin.
    fn seed(&self, id: usize) -> DVec3 {
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        DVec3::from_array(seed_positions.of(id).map(f64::from))
    }

    /// The scene of a lattice that exceeds its budget, merged until it holds it; what cannot be merged
    /// that far loses the components of the fewest points.
    fn within_budget(&self) -> Option<Self> {
        let most = self.config.max_components;
        if !self.config.births.is_order_invariant() || self.components.used() <= most {
            return None;
        }
        // In stored order, that of the lattice: the order of births is that of the frames.
        let mut merged = Self::restore(&self.config, self.state_with(self.shown()), self.frames)?;
        merged.merge_to(most);
        for id in merged.component_sums.keep_fullest(most) {
            merged.photometric.forget(id as usize);
        }
        Some(merged)
    }

    fn every_splat(&self) -> SplatSet {
        let splats = (0..self.component_sums.len()).into_par_iter().with_min_len(256);
        let (splats, appearance) = splats.map(|id| self.splat(id)).unzip();
        self.set_of(splats, appearance)
    }

    fn set_of(&self, splats: Vec<Splat>, appearance: Vec<Appearance>) -> SplatSet {
        let h = self.config.h;
        let exposures = (!self.exposures.is_empty())
            .then(|| Arc::new(ExposureLog::new(self.exposures.clone(), h)));
        let poses = (!self.poses.is_empty()).then(|| Arc::new(PoseLog::new(self.poses.clone(), h)));
        let full_coverage = self.config.splat_rule.full_coverage as f32;
        SplatSet::new(splats, appearance).finished(Finishing { full_coverage, exposures, poses })
    }
}
