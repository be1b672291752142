//! Trainer of the scene preset: owns the components and adds frames to them.
//!
//! The order of the stages follows their dependencies (`scene.md`, Stages of a frame): the pose is corrected
//! before points are assigned, births precede the sums, and visibility uses the means after the frame.

mod budget;
mod photograph;
mod posing;
mod seam;

use super::accumulate::AssignedPoints;
use super::component_sums::ComponentSums;
use super::components::{Components, SeedPositions};
use super::config::SceneConfig;
use super::explain::Explainer;
use super::gain::{MIN_MATCHES, fewest_matches, gain};
use super::grid::SeedGrid;
use super::merge;
use super::observe::observe;
use super::photometric::PhotometricLearner;
use super::point_fits::PointFits;
use super::seed_groups::Reach;
use crate::math::camera::Camera;
use crate::model::conjugate::prior::Hyper;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::splat_rule::{PointExtent, SplatContext};
use crate::model::scene::state::{SceneState, TrackedPose};
use crate::model::scene::sums::SceneSums;
use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
use crate::model::splat::pose_log::{ExposureLog, FrameExposure, FramePose, PoseLog};
use crate::model::splat::splats::Splat;
use crate::observation::surface::{DepthTolerance, Observation, SurfacePoint};
use crate::train::component_elbo::ComponentElbo;
use crate::train::estep::Scoring;
use crate::train::learner::Learner;
use crate::train::outcome::{ComparedPhotograph, FrameOutcome};
use crate::train::timing::{SCENE_STAGES, SceneStage, StageMs, Stopwatch};
use glam::DVec3;
use rayon::prelude::*;
use std::sync::Arc;

// Interval, in frames, at which all components are reported as changed.
const EVERYTHING_EVERY: u64 = 16;

/// Points without a component.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct UnassignedPoints {
    /// Points for which the budget had no room.
    pub budget: u64,
    /// Points too far from the origin to be distinguished from their neighbours.
    pub reach: u64,
}

/// Components and buffers.
pub struct SceneTrainer {
    /// Configuration, with the current structural scale, which may have grown.
    config: SceneConfig,
    /// Configured structural scale, world units.
    scale: f64,
    /// Number of steps by which it has grown.
    coarsened: u32,
    origin: DVec3,
    hyper: Hyper,
    scoring: Scoring,
    grid: SeedGrid,
    components: Components,
    component_sums: ComponentSums,
    /// Assigns and sums points on the processor or a device.
    fits: PointFits,
    owners: Vec<u32>,
    shifts: Vec<f32>,
    /// Squared distance of every point of the last frame from its seed.
    q: Vec<f64>,
    component_elbo: ComponentElbo,
    touched: Vec<u32>,
    /// True if the last frame changed components that are not in `touched`.
    has_changed_all: bool,
    frames: u64,
    unassigned: UnassignedPoints,
    /// Exposures of the frames, if gains are estimated.
    exposures: Vec<FrameExposure>,
    /// Pose corrections of the frames, unless poses count as exact.
    poses: Vec<FramePose>,
    /// Tracked camera poses, if poses are tracked.
    trajectory: Vec<TrackedPose>,
    /// Buffer for the current frame's points under the corrected pose.
    moved: Vec<SurfacePoint>,
    photometric: PhotometricLearner,
    /// State after steps for all buffered photographs; reset by the next frame.
    settled: Option<PhotometricState>,
    /// Comparisons of the last frame, or of the photographs settled since.
    compared: Vec<ComparedPhotograph>,
}

impl SceneTrainer {
    /// Creates an empty scene, whose positions are relative to `origin` (world units).
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        let hyper = Hyper::scene(config.h);
        let scoring = Scoring::new(&hyper);
        Self {
            config: config.clone(),
            scale: config.h,
            coarsened: 0,
            origin,
            hyper,
            scoring,
            grid: SeedGrid::new(config.h),
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
            trajectory: Vec::new(),
            moved: Vec::new(),
            photometric: PhotometricLearner::default(),
            settled: None,
            compared: Vec::new(),
        }
    }

    /// Resumes a scene with the same configuration after `frames` frames; `None` if seeds are too far from the
    /// origin for their scale.
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        let h = config.h * merge::factor(state.coarsening_steps);
        let mut trainer =
            Self::new(&SceneConfig { h, ..config.clone() }, DVec3::from_array(state.origin));
        (trainer.scale, trainer.coarsened) = (config.h, state.coarsening_steps);
        trainer.component_sums = ComponentSums::restore(state.sums, state.visibility);
        let shares = state.shares.unwrap_or_default();
        for place in state.seeds {
            if !trainer.grid.has_cell(place) {
                return None;
            }
            trainer.grid.insert(place);
        }
        trainer.components = match state.components {
            Some(of_seeds) => Components::restore(of_seeds, trainer.component_sums.len(), shares)?,
            None => Components::of_seeds(trainer.grid.len(), shares),
        };
        trainer.exposures = state.exposures;
        trainer.poses = state.poses;
        trainer.trajectory = state.trajectory;
        trainer.photometric = PhotometricLearner::restore(state.photometric.unwrap_or_default());
        let sums = &trainer.component_sums;
        trainer.photometric.observe(|id| sums.observed_cone(id));
        trainer.frames = frames;
        Some(trainer)
    }

    /// Returns the current state.
    pub fn state(&self) -> SceneState {
        let (sums, visibility) = self.component_sums.state();
        let n = self.component_sums.len();
        let photometric = self.config.photometric.map(|_| self.photometric.state().stored(n));
        SceneState {
            origin: self.origin.to_array(),
            coarsening_steps: self.coarsened,
            seeds: (0..self.grid.len()).map(|seed| self.grid.position(seed)).collect(),
            shares: self.components.shares().map(<[u8]>::to_vec),
            components: self.components.shared().map(<[u32]>::to_vec),
            sums,
            visibility,
            exposures: self.exposures.clone(),
            poses: self.poses.clone(),
            trajectory: self.trajectory.clone(),
            photometric,
        }
    }

    /// Trains on one frame; cannot fail.
    pub fn train(&mut self, frame: &Observation) -> FrameOutcome {
        let was_settled = self.drop_settled();
        let outcome = self.learn_frame(frame);
        self.has_changed_all |= was_settled;
        outcome
    }

    fn learn_frame(&mut self, frame: &Observation) -> FrameOutcome {
        let wall = Stopwatch::start();
        let mut ms = StageMs::new(&SCENE_STAGES);
        let mut clock = Stopwatch::start();
        let mut lap = |ms: &mut StageMs, stage: SceneStage| ms.add(stage as usize, clock.lap_ms());
        let (moved, camera) = match self.points_and_camera(frame) {
            Ok(placed) => placed,
            Err(loss) => {
                lap(&mut ms, SceneStage::Pose);
                ms.train = wall.elapsed_ms();
                return self.skip_frame(loss, ms);
            }
        };
        let tracking = self.tracking();
        let points = moved.as_deref().unwrap_or(&frame.points);
        lap(&mut ms, SceneStage::Pose);
        self.begin_and_assign(points);
        let gain = self.gain(points, frame.point_weight);
        let contradicts = self.is_outlier(frame, &camera, points, gain);
        lap(&mut ms, SceneStage::Assign);
        if contradicts {
            self.touched.clear();
            self.end_frame(moved, false);
            ms.train = wall.elapsed_ms();
            return FrameOutcome { tracking, ms, ..FrameOutcome::default() };
        }
        let coarsened = self.coarsened;
        let [born, merged] = self.create_within_budget(points, |stage| lap(&mut ms, stage));
        let (n_points, elbo_mean) = self.explain(points, frame.tolerance);
        // Merging and coarsening may have changed the assignment.
        let is_rebuilt = merged > 0 || self.coarsened != coarsened;
        let gain = if is_rebuilt { self.gain(points, frame.point_weight) } else { gain };
        lap(&mut ms, SceneStage::Refine);
        self.sum_up(points, frame.point_weight, gain);
        lap(&mut ms, SceneStage::Stats);
        // After the sums, so that components count the frame in which they were born.
        self.count_visibility(frame, &camera);
        lap(&mut ms, SceneStage::Visibility);
        self.learn_photograph(frame, &camera, gain);
        lap(&mut ms, SceneStage::Photometric);
        self.log_frame(frame, &camera, gain);
        let is_moved = self.move_to_recorded(frame);
        lap(&mut ms, SceneStage::Pose);
        // Merging and coarsening also change components without points.
        self.end_frame(moved, is_rebuilt || is_moved);
        ms.train = wall.elapsed_ms();
        FrameOutcome {
            points: n_points,
            evidence: n_points as u64 * u64::from(frame.point_weight),
            elbo_mean,
            new_components: born,
            reassigned: 0,
            merged,
            tracking,
            ms,
        }
    }

    /// Logs a frame's exposure and pose correction, if they were estimated.
    fn log_frame(&mut self, frame: &Observation, camera: &Camera, gain: [f32; 3]) {
        if self.config.gain {
            self.exposures.push(FrameExposure::new(&camera.pose, gain));
        }
        if self.config.align && !self.config.track {
            self.poses.push(FramePose::new(&frame.camera.pose, &camera.pose));
        }
    }

    /// Splat of a component from its points alone.
    fn splat_of_points(&self, id: usize) -> (Splat, Appearance) {
        self.config.splat_rule.splat(&self.sums(id), &self.splat_context(id))
    }

    /// Mean and extent of a component's points.
    fn point_extent(&self, id: usize) -> Option<PointExtent> {
        self.config.splat_rule.extent(&self.sums(id), &self.splat_context(id))
    }

    /// Counts the components that the frame saw or saw through.
    fn count_visibility(&mut self, frame: &Observation, camera: &Camera) {
        // Every frame: a row that is not full can take one more frame, since accumulation sums a component
        // with more than 4,096 points wide at once.
        self.component_sums.spill_to_wide_rows(&self.touched);
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        observe(&mut self.component_sums, seed_positions, frame, camera, self.config.h);
    }

    /// Finds the most probable depths of the points. Returns the number of points with a component and the
    /// mean ELBO of their measured positions under the initial model; 0 without points.
    fn explain(&mut self, points: &[SurfacePoint], tolerance: DepthTolerance) -> (usize, f64) {
        let explainer = Explainer {
            component_sums: &self.component_sums,
            seed_positions: SeedPositions { grid: &self.grid, components: &self.components },
            h: self.config.h,
            reach: self.reach(),
            tolerance,
            refines: self.config.refine,
        };
        let (sum, n) = explainer.explain(points, &self.owners, &mut self.q, &mut self.shifts);
        if let Some(owners) = self.component_elbo.owners() {
            owners.clone_from(&self.owners);
            self.component_elbo.accumulate(&self.q, self.components.n_rows());
        }
        (n, if n == 0 { 0.0 } else { self.scoring.elbo(sum / n as f64) })
    }

    /// `weight` is the number of pixels per point.
    fn gain(&self, points: &[SurfacePoint], weight: u32) -> [f32; 3] {
        let fewest = fewest_matches(points.len(), MIN_MATCHES / f64::from(weight));
        let (is_fitted, sums) = (self.config.gain, &self.component_sums);
        if is_fitted { gain(sums, points, &self.owners, fewest) } else { [1.0; 3] }
    }

    /// Returns all sums of a component, in world units about its seed.
    pub fn sums(&self, id: usize) -> SceneSums {
        SceneSums::new(&self.component_sums.sums(id), self.config.h)
    }

    /// Returns the inputs of a component's splat: seed (world units), scale and expected returns.
    pub fn splat_context(&self, id: usize) -> SplatContext {
        let seed = self.seed(id);
        let expected = self.component_sums.row(id).expected();
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let h = self.config.h * seed_positions.share(id);
        SplatContext { seed: self.origin + seed, h, expected, frames: self.frames }
    }

    /// Seed of a component's sums, world units from the origin.
    fn seed(&self, id: usize) -> DVec3 {
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        DVec3::from_array(seed_positions.of(id).map(f64::from))
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

impl SceneTrainer {
    /// Assigns the points of a new frame, for which the device is chosen first.
    fn begin_and_assign(&mut self, points: &[SurfacePoint]) {
        self.fits.begin_frame(points.len(), self.config.h);
        self.assign(points);
    }

    /// Assigns the points of the current frame, possibly again.
    fn assign(&mut self, points: &[SurfacePoint]) {
        let reach = self.reach();
        let Self { fits, grid, components, owners, .. } = self;
        fits.assign(grid, components, reach, points, owners);
    }

    fn reach(&self) -> Reach {
        Reach::new(self.config.h, self.config.ray_search)
    }

    /// Adds the points to the sums.
    fn sum_up(&mut self, points: &[SurfacePoint], weight: u32, gain: [f32; 3]) {
        self.component_sums.grow(self.components.n_rows());
        let (owners, shifts) = (&self.owners, &self.shifts);
        let matched = AssignedPoints { points, owners, shifts, gain, weight };
        let h = self.config.h;
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let (sums, touched) = (&mut self.component_sums, &mut self.touched);
        self.fits.accumulate(sums, seed_positions, matched, h, touched);
    }
}
