//! Pose correction of a frame before training on it.

use super::SceneTrainer;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use crate::model::scene::state::TrackedPose;
use crate::model::splat::pose_log::corrected;
use crate::model::splat::viewpoint::reach;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::scene::align::{
    GROUP_STRIDE, Improvement, KnownPlanes, PoseAlignment, ROUNDS, TURN_DEVIATION,
    alignment_subset, first_groups,
};
use crate::train::scene::components::SeedPositions;
use crate::train::scene::gain::{Brightness, fewest_matches};
use crate::train::scene::gauge::{common_motion, moved_seed};
use crate::train::scene::rigid_equations::Motion;
use crate::train::scene::seed_groups::NearSeeds;
use crate::train::scene::track;
use crate::train::scene::track::TrackingLoss;
use crate::train::timing::StageMs;

/// Number of recent frames used to predict the correction of the next one.
const RECENT: usize = 1000;
/// Minimum number of frames for a motion of the whole scene.
const FEWEST_FRAMES: usize = 4;
/// Number of known points, among those compared, that determine the gain of a large frame.
const MIN_EXPOSED: f64 = 1000.0;

impl SceneTrainer {
    /// Returns points and camera under the aligned pose; no points and the recorded camera if the pose is not
    /// aligned.
    pub(super) fn aligned_points(
        &mut self,
        frame: &Observation,
    ) -> (Option<Vec<SurfacePoint>>, Camera) {
        match self.config.align.then(|| self.motion(frame)).flatten() {
            None => (None, frame.camera),
            Some(motion) => {
                let mut points = std::mem::take(&mut self.moved);
                let camera = motion.apply(frame, &mut points);
                (Some(points), camera)
            }
        }
    }

    /// Returns the most probable motion of a frame; `None` if too little of the scene is known.
    pub(in crate::train::scene) fn motion(&mut self, frame: &Observation) -> Option<Motion> {
        self.motion_of(&alignment_subset(frame))
    }

    /// The same for a frame reduced by [`alignment_subset`].
    pub(super) fn motion_of(&mut self, part: &Observation) -> Option<Motion> {
        let mut owners = std::mem::take(&mut self.owners);
        // Inside the thread pool: rounds are many and short, and starting each from outside would wake
        // threads.
        let found = rayon::scope(|_| self.found_motion(part, &mut owners));
        self.owners = owners;
        found.map(|found| found.motion)
    }

    fn found_motion(&self, part: &Observation, owners: &mut Vec<u32>) -> Option<Improvement> {
        let h = self.config.h;
        let ridge = self.config.splat_rule.gradient_ridge * h * h;
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let mut planes = KnownPlanes::new(&self.component_sums, seed_positions, h, ridge);
        let likely = self.predicted_motion(&part.camera.pose);
        // A subset of the points converges so closely that all of them need only one more round.
        let few = first_groups(part);
        let fewest = fewest_matches(part.points.len(), MIN_EXPOSED);
        let near = self.iterate_rounds(
            &few,
            fewest / GROUP_STRIDE as f64,
            ROUNDS,
            likely,
            &mut planes,
            owners,
        );
        let (start, rounds) = near.map_or((likely, ROUNDS), |near| (near.motion, 1));
        self.iterate_rounds(part, fewest, rounds, start, &mut planes, owners)
    }

    /// Iterates from `motion`, at most `rounds` times, at least once. The gain is estimated only from at
    /// least `fewest` known points.
    fn iterate_rounds(
        &self,
        part: &Observation,
        fewest: f64,
        rounds: usize,
        mut motion: Motion,
        planes: &mut KnownPlanes<'_>,
        owners: &mut Vec<u32>,
    ) -> Option<Improvement> {
        let h = self.config.h;
        let mut near = NearSeeds::new(&self.grid, h as f32, part.points.len());
        for round in 1.. {
            // Reassigned in every round: moved points belong to other components, which determine the
            // remaining motion.
            let gain = self.assign_moved(part, &motion, &mut near, fewest, owners);
            let alignment = PoseAlignment { frame: part, owners, gain, h };
            let improvement = alignment.improve(&motion, planes)?;
            if improvement.has_converged || round >= rounds {
                return Some(improvement);
            }
            motion = improvement.motion;
        }
        None
    }

    /// Assigns the moved points to components and returns the resulting gain.
    fn assign_moved(
        &self,
        part: &Observation,
        motion: &Motion,
        near: &mut NearSeeds<'_>,
        fewest: f64,
        owners: &mut Vec<u32>,
    ) -> [f32; 3] {
        let Self { config, components, component_sums, .. } = self;
        let look = |points: &[SurfacePoint], owners: &[u32]| {
            config.gain.then(|| Brightness::of(component_sums, points, owners))
        };
        let place = motion.point_mover(part);
        let parts = near.assign(components, &part.points, place, owners, look);
        Brightness::gain(parts.into_iter().flatten(), fewest)
    }

    /// Moves the whole scene to minimise its frames' pose corrections, each time their number has doubled:
    /// their common error shrinks with every doubling. Returns true if it moved.
    pub(super) fn move_to_recorded(&mut self, frame: &Observation) -> bool {
        let n = self.poses.len();
        if !self.config.align || self.config.track || n < FEWEST_FRAMES || !n.is_power_of_two() {
            return false;
        }
        let deviations = [TURN_DEVIATION, f64::from(frame.tolerance.place)];
        let Some(motion) = common_motion(&self.poses, deviations) else { return false };
        let (origin, motion) = (self.origin, &motion);
        let moved = self.grid.moved(|seed| moved_seed(seed, origin, motion));
        let Some(moved) = moved else { return false };
        self.grid = moved;
        // The device has the old seeds.
        self.fits.forget_seeds();
        self.component_sums.rotate(motion.rotation());
        self.photometric.move_by(motion);
        self.poses.iter_mut().for_each(|frame| *frame = frame.moved(motion).unwrap_or(*frame));
        self.exposures.iter_mut().for_each(|frame| *frame = frame.moved(motion));
        true
    }

    /// Predicts the motion of a frame: pose errors are similar from frame to frame.
    fn predicted_motion(&self, recorded: &Pose) -> Motion {
        let recent = &self.poses[self.poses.len().saturating_sub(RECENT)..];
        Motion::between(recorded, &corrected(recent, reach(self.config.h), recorded))
    }
}

impl SceneTrainer {
    /// Returns the frame's points and camera under the corrected or tracked pose; no points if unchanged.
    pub(super) fn points_and_camera(
        &mut self,
        frame: &Observation,
    ) -> Result<(Option<Vec<SurfacePoint>>, Camera), TrackingLoss> {
        if !self.config.track {
            return Ok(self.aligned_points(frame));
        }
        let tracked = self.track(frame)?;
        let found = self.align_tracked(frame, &tracked);
        self.trajectory.push(found);
        let pose = found.pose().unwrap_or(frame.camera.pose);
        let mut points = std::mem::take(&mut self.moved);
        let camera = Motion::between(&frame.camera.pose, &pose).apply(frame, &mut points);
        Ok((Some(points), camera))
    }

    /// Corrects a tracked pose like a recorded one: planes and colours of components constrain it better than
    /// the rendered picture used for tracking.
    fn align_tracked(&mut self, frame: &Observation, tracked: &TrackedPose) -> TrackedPose {
        let Some(pose) = tracked.pose() else { return *tracked };
        let mut part = alignment_subset(frame);
        // Recorded positions are more certain than tracked ones.
        part.tolerance.place = part.tolerance.refinement;
        let mut points = Vec::with_capacity(part.points.len());
        part.camera = Motion::between(&frame.camera.pose, &pose).apply(&part, &mut points);
        part.points = points;
        match self.motion_of(&part) {
            None => *tracked,
            Some(motion) => {
                let deviations = [tracked.turn_deviation, tracked.shift_deviation];
                let pose = motion.apply_to_pose(&pose);
                TrackedPose::new(&pose, deviations, tracked.overlap, tracked.agreement)
            }
        }
    }

    fn track(&self, frame: &Observation) -> Result<TrackedPose, TrackingLoss> {
        let known: Vec<Pose> = self.trajectory.iter().filter_map(TrackedPose::pose).collect();
        let Some(last) = known.last() else { return track::begin(frame) };
        track::find_pose(self.every_splat().view(), frame, &[*last], &known)
    }

    /// Tracked pose of the current frame.
    pub(super) fn tracking(&self) -> Option<FrameTracking> {
        let found = self.config.track.then(|| self.trajectory.last().copied()).flatten();
        found.map(FrameTracking::Placed)
    }

    /// Skips a frame whose pose was not found.
    pub(super) fn skip_frame(&mut self, loss: TrackingLoss, ms: StageMs) -> FrameOutcome {
        self.touched.clear();
        self.has_changed_all = false;
        FrameOutcome { tracking: Some(FrameTracking::Lost(loss)), ms, ..FrameOutcome::default() }
    }
}
