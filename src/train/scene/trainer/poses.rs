//! Poses of the frames: alignment, tracking, and the logs of corrections and exposures.

use super::scene::Scene;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use crate::model::scene::state::TrackedPose;
use crate::model::splat::appearance::SplatSet;
use crate::model::splat::pose_log::{ExposureLog, FrameExposure, FramePose, PoseLog, corrected};
use crate::model::splat::viewpoint::reach;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::align::{
    GROUP_STRIDE, Improvement, KnownPlanes, PoseAlignment, ROUNDS, TURN_DEVIATION,
    alignment_subset, first_groups,
};
use crate::train::scene::gain::{Brightness, fewest_matches};
use crate::train::scene::gauge::{common_motion, own_corrections};
use crate::train::scene::rigid_equations::Motion;
use crate::train::scene::seed_groups::NearSeeds;
use crate::train::scene::track;
use crate::train::scene::track::TrackingLoss;
use std::sync::Arc;

/// Number of recent frames used to predict the pose correction of the next frame.
const RECENT: usize = 1000;
/// Approximate number of pose corrections whose size is that of all.
const SAMPLED_CORRECTIONS: usize = 256;
/// Prior deviation of a photograph's pose from that of its points, relative to the correction of a recorded pose.
const PHOTOGRAPH_SHARE: f64 = 0.1;
/// Minimum number of frames before the whole scene is moved to fit the recorded poses.
const FEWEST_FRAMES: usize = 4;
/// Number of compared points in known components that suffices to determine the gain of a large frame.
const MIN_EXPOSED: f64 = 1000.0;

/// Poses and exposures of the frames so far.
#[derive(Default)]
pub(super) struct Poses {
    /// Exposures of the frames, if gains are estimated.
    exposures: Vec<FrameExposure>,
    /// Pose corrections of the frames, unless recorded poses are treated as exact.
    corrections: Vec<FramePose>,
    /// Tracked camera poses, if poses are tracked.
    trajectory: Vec<TrackedPose>,
    /// Buffer for the current frame's points under the corrected pose.
    buffer: Vec<SurfacePoint>,
}

/// Camera and points of a frame under its corrected pose.
pub(super) struct PlacedFrame {
    pub camera: Camera,
    /// Points under the corrected pose; `None` if the recorded pose is used.
    moved: Option<Vec<SurfacePoint>>,
}

impl PlacedFrame {
    pub fn points<'a>(&'a self, frame: &'a Observation) -> &'a [SurfacePoint] {
        self.moved.as_deref().unwrap_or(&frame.points)
    }
}

/// Columns of [`Poses`] as stored in a checkpoint.
pub(super) type PoseColumns = (Vec<FrameExposure>, Vec<FramePose>, Vec<TrackedPose>);

impl Poses {
    pub fn restore((exposures, corrections, trajectory): PoseColumns) -> Self {
        Self { exposures, corrections, trajectory, buffer: Vec::new() }
    }

    pub fn columns(&self) -> PoseColumns {
        (self.exposures.clone(), self.corrections.clone(), self.trajectory.clone())
    }

    /// Corrects the recorded pose of a frame by alignment to the scene, if alignment is on. `owners` is
    /// a buffer for the component of each point.
    pub fn align(
        &mut self,
        scene: &Scene,
        frame: &Observation,
        owners: &mut Vec<u32>,
    ) -> PlacedFrame {
        let motion =
            scene.config.align.then(|| self.motion(scene, &alignment_subset(frame), owners));
        match motion.flatten() {
            None => PlacedFrame { camera: frame.camera, moved: None },
            Some(motion) => self.moved(frame, &motion),
        }
    }

    fn moved(&mut self, frame: &Observation, motion: &Motion) -> PlacedFrame {
        let mut points = std::mem::take(&mut self.buffer);
        let camera = motion.apply(frame, &mut points);
        PlacedFrame { camera, moved: Some(points) }
    }

    /// Finds the pose of a frame that has no recorded pose, by comparison with the rendered scene.
    /// `scene` returns the splats to render.
    pub fn track(
        &self,
        frame: &Observation,
        scene: impl FnOnce() -> SplatSet,
    ) -> Result<TrackedPose, TrackingLoss> {
        let known: Vec<Pose> = self.trajectory.iter().filter_map(TrackedPose::pose).collect();
        let Some(last) = known.last() else { return track::begin(frame) };
        track::find_pose(scene().view(), frame, &[*last], &known)
    }

    /// Corrects a tracked pose like a recorded one and adds it to the trajectory. Planes and colours of
    /// components constrain a pose better than the rendered picture. Returns the frame under the
    /// corrected pose, and the entry in the trajectory.
    pub fn place_tracked(
        &mut self,
        scene: &Scene,
        frame: &Observation,
        tracked: &TrackedPose,
        owners: &mut Vec<u32>,
    ) -> (PlacedFrame, TrackedPose) {
        let found = self.corrected(scene, frame, tracked, owners).unwrap_or(*tracked);
        self.trajectory.push(found);
        let pose = found.pose().unwrap_or(frame.camera.pose);
        (self.moved(frame, &Motion::between(&frame.camera.pose, &pose)), found)
    }

    fn corrected(
        &self,
        scene: &Scene,
        frame: &Observation,
        tracked: &TrackedPose,
        owners: &mut Vec<u32>,
    ) -> Option<TrackedPose> {
        let pose = tracked.pose()?;
        let mut part = alignment_subset(frame);
        // Recorded positions are more certain than tracked ones.
        part.tolerance.place = part.tolerance.refinement;
        let mut points = Vec::with_capacity(part.points.len());
        part.camera = Motion::between(&frame.camera.pose, &pose).apply(&part, &mut points);
        part.points = points;
        let motion = self.motion(scene, &part, owners)?;
        let deviations = [tracked.turn_deviation, tracked.shift_deviation];
        let pose = motion.apply_to_pose(&pose);
        Some(TrackedPose::new(&pose, deviations, tracked.overlap, tracked.agreement))
    }

    /// Returns the motion that most probably corrects the pose of `part`, a frame reduced by
    /// [`alignment_subset`]. `None` if too few components are known.
    pub fn motion(
        &self,
        scene: &Scene,
        part: &Observation,
        owners: &mut Vec<u32>,
    ) -> Option<Motion> {
        // Pose errors are similar from frame to frame.
        let recent = &self.corrections[self.corrections.len().saturating_sub(RECENT)..];
        let recorded = &part.camera.pose;
        let likely = Motion::between(recorded, &corrected(recent, reach(scene.config.h), recorded));
        Alignment::new(scene).motion(part, likely, owners)
    }

    /// Logs a frame's exposure and pose correction, if they were estimated, and reclaims the point
    /// buffer of `placed`.
    pub fn log(&mut self, scene: &Scene, frame: &Observation, placed: PlacedFrame, gain: [f32; 3]) {
        let pose = &placed.camera.pose;
        if scene.config.gain {
            self.exposures.push(FrameExposure::new(pose, gain));
        }
        if scene.config.align && !scene.config.track {
            self.corrections.push(FramePose::new(&frame.camera.pose, pose));
        }
        self.recycle(placed);
    }

    pub fn recycle(&mut self, placed: PlacedFrame) {
        self.buffer = placed.moved.unwrap_or_default();
    }

    /// Returns the motion of the whole scene that minimises the pose corrections of its frames. `None`
    /// unless the number of corrected frames is a power of two. The pose error common to all frames
    /// shrinks with every such motion.
    pub fn common_motion(&self, scene: &Scene, frame: &Observation) -> Option<Pose> {
        let n = self.corrections.len();
        let is_due =
            // Tracked poses have no recorded frame of reference to return to.
            scene.config.align && !scene.config.track && n >= FEWEST_FRAMES && n.is_power_of_two();
        let deviations = [TURN_DEVIATION, f64::from(frame.tolerance.place)];
        is_due.then(|| common_motion(&self.corrections, deviations)).flatten()
    }

    /// Returns the prior standard deviations of the rotation (radians) and position (world units) of a photograph about
    /// the pose of its points; `None` if the two are the same: poses are exact or hardly known.
    pub fn photograph_deviations(&self, scene: &Scene) -> Option<[f64; 2]> {
        let Scene { config, .. } = scene;
        // Points alone use no photograph, so nothing is computed for them.
        let is_used = config.photometric.is_some() && config.align && !config.track;
        if !is_used || config.photographs_at_points || self.corrections.len() < FEWEST_FRAMES {
            return None;
        }
        let every = self.corrections.len().div_ceil(SAMPLED_CORRECTIONS);
        let some: Vec<FramePose> = self.corrections.iter().step_by(every).copied().collect();
        let [turn, shift] = own_corrections(&some, [TURN_DEVIATION, scene.config.h])?;
        (turn > 0.0 && shift > 0.0).then(|| [turn, shift].map(|own| PHOTOGRAPH_SHARE * own))
    }

    pub fn move_by(&mut self, motion: &Pose) {
        let corrections = self.corrections.iter_mut();
        // Frames of older checkpoints lack the rotation and stay.
        corrections.for_each(|frame| *frame = frame.moved(motion).unwrap_or(*frame));
        self.exposures.iter_mut().for_each(|frame| *frame = frame.moved(motion));
    }

    /// Returns the logs of exposures and pose corrections for drawing a scene of structural scale `h`
    /// (world units). `None` in place of an empty log.
    pub fn logs(&self, h: f64) -> (Option<Arc<ExposureLog>>, Option<Arc<PoseLog>>) {
        let exposures = (!self.exposures.is_empty())
            .then(|| Arc::new(ExposureLog::new(self.exposures.clone(), h)));
        let poses = (!self.corrections.is_empty())
            .then(|| Arc::new(PoseLog::new(self.corrections.clone(), h)));
        (exposures, poses)
    }
}

/// Alignment of one frame to a scene.
struct Alignment<'a> {
    scene: &'a Scene,
    planes: KnownPlanes<'a>,
}

impl<'a> Alignment<'a> {
    fn new(scene: &'a Scene) -> Self {
        let h = scene.config.h;
        let ridge = scene.config.splat_rule.gradient_ridge * h * h;
        Self { scene, planes: KnownPlanes::new(&scene.sums, &scene.seeds, h, ridge) }
    }

    fn motion(
        &mut self,
        part: &Observation,
        likely: Motion,
        owners: &mut Vec<u32>,
    ) -> Option<Motion> {
        // A subset of the points converges so closely that all of them need only one more round.
        let few = first_groups(part);
        let fewest = fewest_matches(part.points.len(), MIN_EXPOSED);
        let near = self.iterate_rounds(&few, fewest / GROUP_STRIDE as f64, ROUNDS, likely, owners);
        // Without a result of the subset all points start from the prediction.
        let (start, rounds) = near.map_or((likely, ROUNDS), |near| (near, 1));
        self.iterate_rounds(part, fewest, rounds, start, owners)
    }

    /// Improves `motion` in at least one and at most `rounds` rounds. Each round assigns the points to
    /// components and aligns the frame with the assigned components. The exposure gain is estimated only
    /// if at least `fewest` points belong to known components. `None` if too few components are known.
    fn iterate_rounds(
        &mut self,
        part: &Observation,
        fewest: f64,
        rounds: usize,
        mut motion: Motion,
        owners: &mut Vec<u32>,
    ) -> Option<Motion> {
        let (scene, seeds) = (self.scene, &self.scene.seeds);
        let h = scene.config.h;
        let mut near = NearSeeds::new(&seeds.grid, h as f32, part.points.len());
        let brightness = |points: &[SurfacePoint], owners: &[u32]| {
            scene.config.gain.then(|| Brightness::of(&scene.sums, points, owners))
        };
        // Ends by `return`, since the range is unbounded.
        for round in 1.. {
            // Reassigned in every round: moved points belong to other components, which determine the
            // remaining motion.
            let place = motion.point_mover(part);
            let parts = near.assign(&seeds.components, &part.points, place, owners, brightness);
            let gain = Brightness::gain(parts.into_iter().flatten(), fewest);
            let alignment = PoseAlignment { frame: part, owners, gain, h };
            let improvement = alignment.improve(&motion, &mut self.planes)?;
            let Improvement { motion: improved, has_converged } = improvement;
            if has_converged || round >= rounds {
                return Some(improved);
            }
            motion = improved;
        }
        None
    }
}
