//! Photographs of the frames: an outlier test before training on a frame, and the photometric step
//! after its points have been added.

use super::Changes;
use super::poses::PlacedFrame;
use super::scene::Scene;
use crate::math::camera::{Camera, Intrinsics};
use crate::math::pose::Pose;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::waiting::PhotographView;
use crate::model::splat::pose_log::PoseLog;
use crate::model::splat::texture::Textures;
use crate::observation::surface::{Observation, Photograph, SurfacePoint};
use crate::render::cpu::photometric::RowSubset;
use crate::render::near_plane_for;
use crate::train::learner::Changed;
use crate::train::outcome::{ComparedPhotograph, PhotographOutcome};
use crate::train::scene::photometric::agreement::FrameBesideScene;
use crate::train::scene::photometric::waiting::{CONTRADICTION, packed, update_point_residuals};
use crate::train::scene::photometric::{
    AlignedPhotograph, PhotometricLearner, SplatStep, TrainingView,
};
use crate::train::scene::textures::Taken;
use crate::train::timing::Stopwatch;
use std::sync::Arc;

// Stride over the points to estimate the distance of a frame's nearest surfaces.
const NEAREST_OF: usize = 16;
/// Share of points that may be nearer than the estimated distance of the nearest surfaces.
const NEARER: f64 = 0.02;

/// Returns a distance from the camera that nearly all points of a frame exceed, world units; 0 if there
/// are no points.
fn nearest(points: &[SurfacePoint]) -> f64 {
    let mut ranges: Vec<f32> = points.iter().step_by(NEAREST_OF).map(|p| p.range).collect();
    // A quantile instead of the minimum, which a single stray point would set.
    let at = (ranges.len() as f64 * NEARER) as usize;
    match ranges.is_empty() {
        true => 0.0,
        false => f64::from(*ranges.select_nth_unstable_by(at, f32::total_cmp).1),
    }
}

/// Returns the number of pixels of a photograph per pixel of its depth image, at least 1.
fn pixels_for_each(depth: &Intrinsics, photograph: &Photograph) -> f64 {
    let depth = f64::from(depth.width) * f64::from(depth.height);
    (photograph.colors.data.len() as f64 / depth).max(1.0)
}

/// Photometric training of a scene: learner, temporary state for drawing, and comparisons.
#[derive(Default)]
pub(super) struct Photographs {
    pub learner: PhotometricLearner,
    /// State for drawing, after the photometric steps for all buffered photographs. Dropped when
    /// training resumes.
    pub settled: Option<PhotometricState>,
    /// Comparisons of photographs during the last frame, or during the last [`Self::settle`].
    pub compared: Vec<ComparedPhotograph>,
}

impl Photographs {
    pub fn restore(mut state: PhotometricState, scene: &Scene) -> Self {
        // Files end with the last texture, the list in training with the last component.
        if !state.textures.is_empty() {
            state.textures.resize(state.splats.len(), None);
        }
        let learner = PhotometricLearner::restore(state);
        let mut photographs = Self { learner, ..Self::default() };
        photographs.observe(scene, Changed::All);
        photographs
    }

    /// Resumes training: drops the temporary state for drawing and clears the comparisons. Returns true
    /// if there was such a state.
    pub fn resume(&mut self) -> bool {
        self.compared.clear();
        self.learner.comparers.end_settling();
        // Settling is not part of a frame.
        self.learner.texture_ms = 0.0;
        let was_settled = self.settled.take().is_some();
        if was_settled {
            self.learner.textures.forget_drawn();
        }
        was_settled
    }

    /// True if a frame is an outlier because its points disagree with the scene. Always false without
    /// photometric training, so that scenes trained on points alone do not depend on this test.
    pub fn is_outlier(
        &mut self,
        scene: &Scene,
        frame: &Observation,
        placed: &PlacedFrame,
        owners: &[u32],
        gain: [f32; 3],
    ) -> bool {
        if scene.config.photometric.is_none() {
            return false;
        }
        let comparison = FrameBesideScene {
            component_sums: &scene.sums,
            seeds: &scene.seeds,
            h: scene.config.h,
            frame,
            camera: &placed.camera,
            points: placed.points(frame),
            owners,
            gain,
        };
        let outcome = update_point_residuals(&mut self.learner.state, &comparison.agreement());
        self.compared.extend(outcome.map(|outcome| compared_now(scene, outcome)));
        outcome.is_some()
    }

    /// Trains on the photograph of a frame, if photometric training is on. First initialises the splats
    /// of changed components. Then takes the photometric step of the photograph. With a shuffle buffer,
    /// the photograph is buffered instead, and the step of a random buffered one is taken.
    pub fn learn(
        &mut self,
        scene: &Scene,
        frame: &Observation,
        camera: &Camera,
        gain: [f32; 3],
        pose_deviations: Option<[f64; 2]>,
        changes: &mut Changes,
    ) {
        let Some(rule) = scene.config.photometric_rule() else { return };
        if frame.photograph.is_some() {
            let points = |id| scene.sums.plane_sums(id).0;
            let splat = |id| scene.splat(id);
            let n = scene.sums.len();
            self.learner.initialise_splats(n, changes.listed(), &rule, points, splat);
        }
        self.observe(scene, changes.get());
        let Some(photograph) = &frame.photograph else { return };
        let extents = |id| scene.extent(id);
        let full_coverage = scene.config.splat_rule.full_coverage;
        let step = SplatStep::new(full_coverage, &rule, &extents, pose_deviations);
        let taken = Taken {
            photograph,
            camera: photograph.camera(&camera.pose),
            near: near_plane_for(nearest(&frame.points)),
            gain,
            margin: frame.tolerance.margin,
            per_depth_pixel: pixels_for_each(&frame.camera.intrinsics, photograph),
            frame: scene.frames,
        };
        let (pose, due) = self.align(taken, &step);
        if scene.config.texture_mb > 0 {
            let taken = Taken { camera: Camera { pose, ..taken.camera }, ..taken };
            let PhotometricLearner { state, textures, texture_ms, .. } = &mut self.learner;
            let (budget, clock) = (scene.config.texture_bytes(), Stopwatch::start());
            textures.learn(state, changes.listed(), scene.config.h, budget, &taken);
            *texture_ms += clock.elapsed_ms();
        }
        if let Some(due) = due {
            let (changed, compared) = self.learner.learn(due, &step);
            self.compared.extend(compared);
            changes.add(&changed);
        }
    }

    /// Returns the pose of a photograph for its textures, and the photograph whose photometric step is due: with a
    /// shuffle buffer a random one, else the same.
    fn align(
        &mut self,
        taken: Taken<'_>,
        step: &SplatStep<'_>,
    ) -> (Pose, Option<AlignedPhotograph>) {
        // Elsewhere the gain is not worth a second picture.
        let is_aligned = taken.is_fine();
        let Taken { photograph, camera, near, gain, margin, per_depth_pixel, frame } = taken;
        let rule = step.rule;
        let stride = rule.row_stride(photograph.colors.data.len(), per_depth_pixel);
        let rows = RowSubset::new(stride, frame);
        if rule.shuffle_buffer == 0 {
            let pixels = photograph.measured_pixels(gain, margin);
            let outlier_factor = CONTRADICTION;
            let view = TrainingView { camera, near, rows, outlier_factor, per_depth_pixel, frame };
            let aligned = self.learner.aligned(view, pixels, step);
            return (aligned.view.camera.pose, Some(aligned));
        }
        let rows = [rows.stride(), rows.first()];
        let view = PhotographView::new(frame, &camera, gain, near, rows);
        let packed = packed(PhotographView { per_depth_pixel, ..view }, photograph, margin);
        // The textures lack this photograph, so they do not hold it at the pose of the points.
        let own = is_aligned.then(|| self.learner.textured_pose_of(&packed, step)).flatten();
        let most = rule.most_waiting(packed.bytes());
        self.learner.state.buffered.push(packed);
        (own.unwrap_or(camera.pose), self.learner.draw_beyond(most, step))
    }

    /// Updates the range of view directions from which changed components were observed.
    fn observe(&mut self, scene: &Scene, changed: Changed<'_>) {
        self.learner.observe(changed, |id| scene.sums.observed_cone(id));
    }

    /// Applies a rigid motion of the world to splats and buffered photographs. `scene` must have been
    /// moved before.
    pub fn move_by(&mut self, scene: &Scene, motion: &Pose) {
        self.learner.state.move_by(motion);
        self.learner.textures.forget_drawn();
        self.observe(scene, Changed::All);
    }

    /// Computes the state for drawing, after the photometric steps for all buffered photographs. Returns
    /// true if a new state was computed.
    pub fn settle(&mut self, scene: &Scene, pose_deviations: Option<[f64; 2]>) -> bool {
        let Some(rule) = scene.config.photometric_rule() else { return false };
        if self.settled.is_some() || self.learner.state.buffered.is_empty() {
            return false;
        }
        let extents = |id| scene.extent(id);
        let step =
            SplatStep::new(scene.config.splat_rule.full_coverage, &rule, &extents, pose_deviations);
        let (settled, compared) = self.learner.settled_state(&step);
        (self.settled, self.compared) = (Some(settled), compared);
        // Judged by more photographs than those that training has learned from.
        self.learner.textures.forget_drawn();
        true
    }

    /// Returns the textures to draw; `None` if there are none.
    pub fn drawn_textures(&self) -> Option<Arc<Textures>> {
        self.learner.textures.drawn(self.drawn())
    }

    /// Returns the poses of the photographs for drawing a scene of structural scale `h`; `None` if they are those of
    /// the points.
    pub fn drawn_poses(&self, h: f64) -> Option<Arc<PoseLog>> {
        let poses = &self.drawn().photograph_poses;
        (!poses.is_empty()).then(|| Arc::new(PoseLog::new(poses.clone(), h)))
    }

    /// Returns the photometric state from which splats are drawn.
    pub fn drawn(&self) -> &PhotometricState {
        self.settled.as_ref().unwrap_or(&self.learner.state)
    }
}

fn compared_now(scene: &Scene, outcome: PhotographOutcome) -> ComparedPhotograph {
    ComparedPhotograph { frame: scene.frames, outcome }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::image::Image;
    use crate::model::scene::texels::TextureSums;
    use crate::model::splat::appearance::SplatView;
    use crate::render::cpu::CpuRenderer;
    use crate::render::{RenderMethod, RenderOptions};
    use crate::train::scene::photometric::fixtures::{DEVIATIONS, apart, camera, moved, wall};
    use crate::train::scene::photometric::rule::PhotometricRule;
    use glam::{DQuat, DVec3};

    /// Returns a photograph of the wall, taken from a pose.
    fn photograph(pose: Pose) -> Photograph {
        let (camera, splats) = (camera(pose), wall());
        let options = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        let splats = SplatView::new(&splats, &[]).unwrap();
        let drawn = CpuRenderer::new().render(splats, &camera, &options);
        let byte = |[r, g, b]: &[f32; 3]| [*r, *g, *b, 1.0].map(|x| (x * 255.0 + 0.5) as u8);
        Photograph {
            intrinsics: camera.intrinsics,
            offset: DVec3::ZERO,
            rotation: DQuat::IDENTITY,
            colors: drawn.color.map(byte).into(),
            gain: [1.0; 3],
            depths: Image::from_vec(160, 120, drawn.depth.data),
            has_coverage: false,
        }
    }

    #[test]
    fn textures_learn_from_the_photographs_own_pose() {
        let photograph = photograph(moved());
        let taken = Taken {
            photograph: &photograph,
            camera: photograph.camera(&Pose::IDENTITY),
            near: 0.2,
            gain: [1.0; 3],
            margin: [0.02, 0.0],
            per_depth_pixel: 2.0,
            frame: 0,
        };
        for shuffle_buffer in [0, 1] {
            let rule = PhotometricRule { shuffle_buffer, ..PhotometricRule::DEFAULT };
            let step = SplatStep::new(1.0, &rule, &|_| None, Some(DEVIATIONS));
            let mut photographs = Photographs::default();
            let state = &mut photographs.learner.state;
            state.grow(wall().len());
            state.splats = wall();
            state.textures = vec![Some(Arc::new(TextureSums::new(&wall()[0], 0.1)))];
            let (pose, due) = photographs.align(taken, &step);
            let (before, after) = (apart(&Pose::IDENTITY, &moved()), apart(&pose, &moved()));
            assert!(before > 4e-3 && after < 0.1 * before, "{before} {after}");
            assert_eq!(due.is_some(), shuffle_buffer == 0, "the buffer is filled first");
            // Without textures the pose of the second one is that of the points.
            photographs.learner.state.textures.clear();
            let (pose, due) = photographs.align(taken, &step);
            let due = due.expect("a photograph beyond the buffer").view.camera.pose;
            assert!(apart(&due, &moved()) < 0.1 * before, "{due:?}");
            assert_eq!(pose == Pose::IDENTITY, shuffle_buffer > 0);
            assert_eq!(photographs.learner.state.buffered.len(), shuffle_buffer);
        }
    }
}
