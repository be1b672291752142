//! Trainer of the scene preset: owns the components and adds frames to them.
//!
//! The order of the stages follows their dependencies (`scene.md`, Stages of a frame): the pose is corrected
//! before points are assigned, births precede the sums, and visibility uses the means after the frame.

mod budget;
mod photographs;
mod points;
mod poses;
mod scene;
mod seam;

use super::component_sums::ComponentSums;
use super::components::Seeds;
use super::config::SceneConfig;
use super::merge;
use super::observe::observe;
use super::track::TrackingLoss;
use crate::math::camera::Camera;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::state::SceneState;
use crate::model::splat::appearance::{Finishing, SplatSet};
use crate::observation::surface::{DepthTolerance, Observation, SurfacePoint};
use crate::train::component_elbo::ComponentElbo;
use crate::train::learner::{Changed, Learner};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::timing::{SCENE_STAGES, SceneStage, StageMs, Stopwatch};
use budget::{FrameComponents, UnassignedPoints};
use glam::DVec3;
use photographs::Photographs;
use points::FramePoints;
use poses::{PlacedFrame, Poses};
use rayon::prelude::*;
use scene::Scene;

// Interval, in frames, at which all components are reported as changed.
const EVERYTHING_EVERY: u64 = 16;

/// Trains a scene, frame by frame.
pub struct SceneTrainer {
    scene: Scene,
    points: FramePoints,
    poses: Poses,
    photographs: Photographs,
    changes: Changes,
    component_elbo: ComponentElbo,
    unassigned: UnassignedPoints,
}

impl SceneTrainer {
    /// Creates an empty scene, whose positions are relative to `origin` (world units).
    ///
    /// ```
    /// use glam::DVec3;
    /// use vbgs_studio::observation::surface::{Observation, SurfacePoint};
    /// use vbgs_studio::train::learner::Learner;
    /// use vbgs_studio::train::scene::{config::SceneConfig, trainer::SceneTrainer};
    ///
    /// let at = |x| SurfacePoint {
    ///     position: [x, 0.0, 1.0],
    ///     normal: [0.0, 0.0, -1.0],
    ///     direction: [0.0, 0.0, 1.0],
    ///     ..SurfacePoint::default()
    /// };
    /// let frame = Observation { points: vec![at(0.0), at(0.05), at(0.5)], ..Observation::empty() };
    /// let mut scene = SceneTrainer::new(&SceneConfig::fine(0.1), DVec3::ZERO);
    /// assert_eq!(scene.train(&frame).points, 3);
    /// assert_eq!(scene.status().used, 2, "one of them had a seed within 0.1");
    /// assert_eq!(scene.component(0).posterior.count, 2.0);
    /// ```
    pub fn new(config: &SceneConfig, origin: DVec3) -> Self {
        let scene = Scene::new(config, origin);
        let mut photographs = Photographs::default();
        photographs.learner.state.texture_steps = config.texture_steps;
        Self {
            component_elbo: ComponentElbo::new(scene.scoring),
            scene,
            points: FramePoints::default(),
            poses: Poses::default(),
            photographs,
            changes: Changes::default(),
            unassigned: UnassignedPoints::default(),
        }
    }

    /// Resumes training of a scene with the same configuration after `frames` frames. `None` if a seed
    /// is too far from the origin for the scale, or a component number is invalid.
    pub fn restore(config: &SceneConfig, state: SceneState, frames: u64) -> Option<Self> {
        // The configuration holds the scale as requested, the state how far it has grown.
        let h = config.h * merge::factor(state.coarsening_steps);
        let wider = SceneConfig { h, ..config.clone() };
        let mut trainer = Self::new(&wider, DVec3::from_array(state.origin));
        let scene = &mut trainer.scene;
        (scene.asked_scale, scene.coarsened) = (config.h, state.coarsening_steps);
        scene.frames = frames;
        scene.sums = ComponentSums::restore(state.sums, state.visibility);
        let (shares, n_rows) = (state.shares.unwrap_or_default(), scene.sums.len());
        scene.seeds = Seeds::restore(h, &state.seeds, state.components, shares, n_rows)?;
        trainer.poses = Poses::restore((state.exposures, state.poses, state.trajectory));
        let photometric = state.photometric.unwrap_or_default();
        trainer.photographs = Photographs::restore(photometric, &trainer.scene);
        Some(trainer)
    }

    /// Returns the current state.
    pub fn state(&self) -> SceneState {
        self.state_with(&self.photographs.learner.state)
    }

    /// Takes the photometric steps for all buffered photographs and returns the resulting state.
    pub(in crate::train::scene) fn into_settled_state(mut self) -> SceneState {
        self.settle_photographs();
        self.state_with(self.photographs.drawn())
    }

    fn settle_photographs(&mut self) -> bool {
        let deviations = self.poses.photograph_deviations(&self.scene);
        rayon::scope(|_| self.photographs.settle(&self.scene, deviations))
    }

    fn learn_photograph(&mut self, frame: &Observation, camera: &Camera, gain: [f32; 3]) {
        let Self { scene, poses, photographs, changes, .. } = self;
        let deviations = poses.photograph_deviations(scene);
        photographs.learn(scene, frame, camera, gain, deviations, changes);
    }

    fn state_with(&self, photometric: &PhotometricState) -> SceneState {
        let Scene { config, coarsened, origin, seeds, sums, .. } = &self.scene;
        let components = &seeds.components;
        let n = sums.len();
        let (sums, visibility) = sums.state();
        let (exposures, poses, trajectory) = self.poses.columns();
        SceneState {
            origin: origin.to_array(),
            coarsening_steps: *coarsened,
            seeds: seeds.grid.positions().to_vec(),
            shares: components.shares().map(<[u8]>::to_vec),
            components: components.shared().map(<[u32]>::to_vec),
            sums,
            visibility,
            exposures,
            poses,
            trajectory,
            photometric: config.photometric.map(|_| photometric.stored(n)),
        }
    }

    /// Trains on one frame. Training cannot fail, but skips outliers and frames whose pose is not found.
    pub fn train(&mut self, frame: &Observation) -> FrameOutcome {
        let mut clock = FrameClock::start();
        self.changes.restart(self.photographs.resume());
        // Inside the thread pool: a frame has a hundred short parallel loops, and starting each from outside would
        // wake threads.
        let outcome = rayon::scope(|_| self.learn_frame(frame, &mut clock));
        FrameOutcome { ms: clock.finish(), ..outcome }
    }

    fn learn_frame(&mut self, frame: &Observation, clock: &mut FrameClock) -> FrameOutcome {
        let placed = self.place(frame);
        clock.lap(SceneStage::Pose);
        let (placed, tracking) = match placed {
            Ok(placed) => placed,
            Err(loss) => {
                return FrameOutcome {
                    tracking: Some(FrameTracking::Lost(loss)),
                    ..FrameOutcome::default()
                };
            }
        };
        let (points, weight) = (placed.points(frame), frame.point_weight);
        self.points.assign_new(&self.scene, points);
        let gain = self.points.gain(&self.scene, points, weight);
        let is_outlier = self.is_outlier(frame, &placed, gain);
        clock.lap(SceneStage::Assign);
        if is_outlier {
            // Neither points nor pose are logged, but the buffer is kept.
            self.poses.recycle(placed);
            self.end_frame();
            return FrameOutcome { tracking, ..FrameOutcome::default() };
        }
        let FrameComponents { born, merged, is_rebuilt } = self.create_within_budget(points, clock);
        let (n_points, elbo_mean) = self.explain(points, frame.tolerance);
        // Merging and coarsening may have changed the assignment.
        let gain = if is_rebuilt { self.points.gain(&self.scene, points, weight) } else { gain };
        clock.lap(SceneStage::Refine);
        self.points.sum_up(&mut self.scene, points, weight, gain, self.changes.touched());
        clock.lap(SceneStage::Stats);
        // Updated after the sums, so that components count the frame in which they were born.
        let Scene { config, seeds, sums, .. } = &mut self.scene;
        observe(sums, seeds, frame, &placed.camera, config.h);
        clock.lap(SceneStage::Visibility);
        self.learn_photograph(frame, &placed.camera, gain);
        clock.lap_photographs(&mut self.photographs);
        self.poses.log(&self.scene, frame, placed, gain);
        self.move_to_recorded(frame);
        self.end_frame();
        clock.lap(SceneStage::Pose);
        FrameOutcome {
            points: n_points,
            evidence: n_points as u64 * u64::from(weight),
            elbo_mean,
            new_components: born,
            merged,
            tracking,
            ..FrameOutcome::default()
        }
    }

    /// Returns the frame under its corrected pose. If poses are tracked, the pose is found from the
    /// scene.
    fn place(
        &mut self,
        frame: &Observation,
    ) -> Result<(PlacedFrame, Option<FrameTracking>), TrackingLoss> {
        if !self.scene.config.track {
            return Ok((self.poses.align(&self.scene, frame, &mut self.points.owners), None));
        }
        let tracked = self.poses.track(frame, || self.splats())?;
        let owners = &mut self.points.owners;
        let (placed, found) = self.poses.place_tracked(&self.scene, frame, &tracked, owners);
        Ok((placed, Some(FrameTracking::Placed(found))))
    }

    /// Returns the camera motion that most probably corrects the recorded pose of a frame.
    #[cfg(test)]
    pub(in crate::train::scene) fn motion(
        &mut self,
        frame: &Observation,
    ) -> Option<super::rigid_equations::Motion> {
        let part = super::align::alignment_subset(frame);
        self.poses.motion(&self.scene, &part, &mut self.points.owners)
    }

    fn is_outlier(&mut self, frame: &Observation, placed: &PlacedFrame, gain: [f32; 3]) -> bool {
        let owners = &self.points.owners;
        self.photographs.is_outlier(&self.scene, frame, placed, owners, gain)
    }

    /// Computes the shift of each point to its most probable depth. Returns the number of points with a
    /// component, and the mean ELBO of the measured positions under the initial model. The ELBO is 0 if
    /// there are no points.
    fn explain(&mut self, points: &[SurfacePoint], tolerance: DepthTolerance) -> (usize, f64) {
        let (sum, n) = self.points.explain(&self.scene, points, tolerance);
        if let Some(owners) = self.component_elbo.owners() {
            owners.clone_from(&self.points.owners);
            let n_rows = self.scene.seeds.components.n_rows();
            self.component_elbo.accumulate(&self.points.q, n_rows);
        }
        (n, if n == 0 { 0.0 } else { self.scene.scoring.elbo(sum / n as f64) })
    }

    /// Moves the whole scene so that the pose corrections of its frames become smallest. This happens
    /// each time the number of frames has doubled.
    fn move_to_recorded(&mut self, frame: &Observation) {
        let Some(motion) = self.poses.common_motion(&self.scene, frame) else { return };
        if !self.scene.seeds.move_by(&motion, self.scene.origin) {
            return;
        }
        // The device has the old seeds.
        self.points.fits.forget_seeds();
        self.scene.sums.rotate(motion.rotation());
        self.photographs.move_by(&self.scene, &motion);
        self.poses.move_by(&motion);
        self.changes.add_all();
    }

    /// Counts a frame that was trained on or skipped as an outlier.
    fn end_frame(&mut self) {
        self.scene.frames += 1;
        // Visibility counts change opacities of components that received no point.
        if self.scene.frames.is_multiple_of(EVERYTHING_EVERY) {
            self.changes.add_all();
        }
    }

    fn set_of(&self, ids: impl IndexedParallelIterator<Item = usize>) -> SplatSet {
        let (splats, appearance): (Vec<_>, Vec<_>) =
            ids.with_min_len(256).map(|id| self.splat(id)).unzip();
        let h = self.scene.config.h;
        let (exposures, poses) = self.poses.logs(h);
        let photograph_poses = self.photographs.drawn_poses(h);
        let textures = self.photographs.drawn_textures();
        let full_coverage = self.scene.config.splat_rule.full_coverage as f32;
        let finishing = Finishing {
            full_coverage,
            is_antialiased: false,
            exposures,
            poses,
            photograph_poses,
            textures,
        };
        SplatSet::new(splats, appearance).finished(finishing)
    }
}

/// Components changed by the last frame.
#[derive(Default)]
pub(super) struct Changes {
    /// Numbers of changed components, ascending.
    listed: Vec<u32>,
    /// True if all components have to be treated as changed.
    has_changed_all: bool,
}

impl Changes {
    /// Clears the list for a new frame. `has_changed_all` is true if all components have to be treated
    /// as changed.
    pub fn restart(&mut self, has_changed_all: bool) {
        self.listed.clear();
        self.has_changed_all = has_changed_all;
    }

    /// Returns the list of changed components for modification. The caller fills it with the components
    /// that have points in the frame.
    pub fn touched(&mut self) -> &mut Vec<u32> {
        &mut self.listed
    }

    pub fn listed(&self) -> &[u32] {
        &self.listed
    }

    /// Adds components, in ascending order, to the list.
    pub fn add(&mut self, changed: &[u32]) {
        self.listed.extend_from_slice(changed);
        // A stable sort, which merges the two sorted runs.
        self.listed.sort();
        self.listed.dedup();
    }

    pub fn add_all(&mut self) {
        self.has_changed_all = true;
    }

    pub fn get(&self) -> Changed<'_> {
        if self.has_changed_all { Changed::All } else { Changed::Listed(&self.listed) }
    }
}

/// Clock for the stages of training on one frame.
struct FrameClock {
    wall: Stopwatch,
    stage: Stopwatch,
    ms: StageMs,
}

impl FrameClock {
    fn start() -> Self {
        let ms = StageMs::new(&SCENE_STAGES);
        Self { wall: Stopwatch::start(), stage: Stopwatch::start(), ms }
    }

    fn lap(&mut self, stage: SceneStage) {
        self.ms.add(stage as usize, self.stage.lap_ms());
    }

    /// Ends the photometric stage and the stage of textures, which runs within it.
    fn lap_photographs(&mut self, photographs: &mut Photographs) {
        let ms = self.stage.lap_ms();
        let texture_ms = std::mem::take(&mut photographs.learner.texture_ms);
        self.ms.add(SceneStage::Textures as usize, texture_ms);
        self.ms.add(SceneStage::Photometric as usize, ms - texture_ms);
    }

    fn finish(mut self) -> StageMs {
        self.ms.train = self.wall.elapsed_ms();
        self.ms
    }
}
