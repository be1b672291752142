//! Second alignment of stored frames, when more of the scene is known, and motion of their contributions
//! (`scene.md`, Second alignment).

use super::SceneTrainer;
use crate::math::camera::Camera;
use crate::math::pose::Pose;
use crate::model::scene::kept::{FrameContribution, StoredFrame, quanta_to_values};
use crate::model::scene::sums::SceneSums;
use crate::model::splat::pose_log::FramePose;
use crate::observation::surface::Observation;
use crate::train::scene::accumulate::PARTS;
use crate::train::scene::align::{ColoredPlane, FrameMatches, Match, RecordedPose, TURN_DEVIATION};
use crate::train::scene::component_sums::SumScalar;
use crate::train::scene::config::{MOST_KEPT_BYTES, MOST_KEPT_FRAMES};
use crate::train::scene::rigid_equations::Motion;
use glam::{DQuat, DVec3};
use rayon::prelude::*;

/// Range of mean distances, in structural scales, for which a frame is moved: smaller motions are not worth
/// the time, larger ones count as errors.
const DISTANCES: std::ops::RangeInclusive<f64> = 0.02..=1.0;

/// Motion of a frame and the resulting change of the sums.
pub(in crate::train::scene) struct FrameChange {
    /// Number of frames trained before it.
    frame: u64,
    /// Index in the log of corrected poses.
    logged: u64,
    /// Motion of the world as seen by the frame.
    motion: Pose,
    /// Changes of the components' sums.
    sums: FrameContribution,
}

impl<W: SumScalar> SceneTrainer<W> {
    /// Trains on the photograph of a frame that is about to be logged, and in parallel aligns due frames a
    /// second time; returns their changes.
    pub(super) fn train_on_photograph_and_realign(
        &mut self,
        frame: &Observation,
        camera: &Camera,
        gain: [f32; 3],
        taught: Option<FrameContribution>,
    ) -> Vec<FrameChange> {
        let kept = self.store_frame(frame, taught);
        let look = |kept: StoredFrame, trainer: &Self| {
            let motion = trainer.align_again(&kept)?;
            Some(trainer.change_under_motion(kept, motion))
        };
        self.learn_photograph(frame, camera, gain, |trainer| {
            kept.into_iter().filter_map(|kept| look(kept, trainer)).collect()
        })
    }

    /// Stores the contributions of a frame that is about to be logged, if it was aligned. Returns the oldest
    /// frames beyond the limit, whose second alignment is due.
    fn store_frame(
        &mut self,
        frame: &Observation,
        taught: Option<FrameContribution>,
    ) -> Vec<StoredFrame> {
        let shown = std::mem::take(&mut self.shown);
        let Some(taught) = taught.filter(|_| !shown.is_empty()) else { return Vec::new() };
        let deviation = f64::from(frame.tolerance.place);
        let logged = self.poses.len() as u64;
        let kept = StoredFrame { frame: self.frames, log_index: logged, deviation, shown, taught };
        self.kept.push_back(kept);
        let mut due = Vec::new();
        while self.kept.len() > MOST_KEPT_FRAMES || self.kept_bytes() > MOST_KEPT_BYTES {
            due.extend(self.kept.pop_front());
        }
        due
    }

    fn kept_bytes(&self) -> usize {
        self.kept.iter().map(StoredFrame::bytes).sum()
    }

    /// Returns the motion of the world as seen by one frame that fits it to the contributions of all others:
    /// the frame is aligned again by the same points to components without its own contributions. `None` if
    /// the motion is too small, too large or unknown.
    pub(in crate::train::scene) fn align_again(&self, kept: &StoredFrame) -> Option<Pose> {
        let h = self.config.h;
        let ridge = self.config.splat_rule.gradient_ridge * h * h;
        let plane = |id: u32| {
            let mut sums = self.component_sums.sums(id as usize);
            let own = quanta_to_values(kept.taught.of(id)?);
            sums.iter_mut().zip(own).for_each(|(sum, own)| *sum -= own);
            ColoredPlane::new(&SceneSums::new(&sums, h), self.seed(id as usize), ridge)
        };
        let shown = kept.shown.par_iter().with_min_len(64);
        let planes: Vec<_> = shown.map(|shown| plane(shown.component)).collect();
        let matches = kept.shown.iter().zip(&planes);
        let matches = matches.filter_map(|(&shown, plane)| Some((shown, plane.as_ref()?)));
        let matches: Vec<_> =
            matches.map(|(shown, plane)| Match { plane, observation: shown }).collect();
        // Points without a component were not stored.
        let found = FrameMatches { matches, share: 1.0 };

        let [recorded, learnt] = self.poses.get(kept.log_index as usize)?.poses()?;
        let centre = recorded.centre() - self.origin;
        let deviations = [TURN_DEVIATION, kept.deviation];
        let before = Motion::between(&recorded, &learnt);
        let pose = RecordedPose { centre, deviations };
        let nearer = pose.step(&found, &before)?;
        let after = pose.step(&found, &nearer)?;
        let (back, place) = learnt.inverse();
        let motion = after.apply_to_pose(&recorded).attached_camera(place, DQuat::from_mat3(&back));

        let distance = |matched: &Match<'_>| {
            let from_camera = matched.observation.position - centre;
            let shift = after.shift - before.shift;
            (after.turn * from_camera - before.turn * from_camera + shift).length()
        };
        let distance = found.matches.iter().map(distance).sum::<f64>() / found.matches.len() as f64;
        DISTANCES.contains(&(distance / h)).then_some(motion)
    }

    /// Computes the changes of the sums due to a frame's motion.
    pub(in crate::train::scene) fn change_under_motion(
        &self,
        kept: StoredFrame,
        motion: Pose,
    ) -> FrameChange {
        let (h, origin) = (self.config.h, self.origin);
        let shift = |id: u32| -> DVec3 {
            let seed = origin + self.seed(id as usize);
            (motion.transform_point(seed) - seed) / h
        };
        let StoredFrame { frame, log_index: logged, taught, .. } = kept;
        let sums = taught.change_under_motion(motion.rotation(), shift);
        FrameChange { frame, logged, motion, sums }
    }

    /// Applies the motion of a frame to its contributions, its buffered photograph and the logs.
    pub(in crate::train::scene) fn apply_change(&mut self, change: &FrameChange) {
        let FrameChange { frame, logged, motion, sums } = change;
        self.component_sums.apply_changes(&sums.ids, &sums.sums, PARTS);
        self.photometric.move_photograph(*frame, motion);
        // Each log is either empty or has an entry for every frame.
        if let Some(exposure) = self.exposures.get_mut(*logged as usize) {
            *exposure = exposure.moved(motion);
        }
        if let Some(logged) = self.poses.get_mut(*logged as usize)
            && let Some([recorded, learnt]) = logged.poses()
        {
            *logged = FramePose::new(&recorded, &learnt.transformed_by(motion));
        }
        self.mark_changed(&sums.ids);
    }
}
