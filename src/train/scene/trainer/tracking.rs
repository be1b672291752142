//! Pose of a frame: recorded and corrected, or tracked.

use super::SceneTrainer;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use crate::model::scene::trajectory::TrackedPose;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::outcome::{FrameOutcome, FrameTracking};
use crate::train::scene::align::alignment_subset;
use crate::train::scene::rigid_equations::Motion;
use crate::train::scene::sum_scalar::SumScalar;
use crate::train::scene::track::{self, TrackingLoss};
use crate::train::timing::StageMs;

impl<W: SumScalar> SceneTrainer<W> {
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
