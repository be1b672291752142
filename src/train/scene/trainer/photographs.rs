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
use crate::train::scene::photometric::{PhotometricLearner, SplatStep, TrainingView};
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
        if scene.config.texture_mb > 0 {
            let taken = Taken {
                photograph,
                camera: photograph.camera(&camera.pose),
                near: near_plane_for(nearest(&frame.points)),
                gain,
                margin: frame.tolerance.margin,
                per_depth_pixel: pixels_for_each(&frame.camera.intrinsics, photograph),
                frame: scene.frames,
            };
            let PhotometricLearner { state, textures, texture_ms, .. } = &mut self.learner;
            let (budget, clock) = (scene.config.texture_bytes(), Stopwatch::start());
            textures.learn(state, changes.listed(), scene.config.h, budget, &taken);
            *texture_ms += clock.elapsed_ms();
        }
        let extents = |id| scene.extent(id);
        let full_coverage = scene.config.splat_rule.full_coverage;
        let step = SplatStep::new(full_coverage, &rule, &extents, pose_deviations);
        let (changed, compared) = self.step(scene, &step, frame, photograph, camera, gain);
        self.compared.extend(compared);
        changes.add(&changed);
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

    /// Takes the photometric step of a photograph, or adds it to the buffer and takes the step of a
    /// buffered one. Returns the changed splats and the comparison.
    fn step(
        &mut self,
        scene: &Scene,
        step: &SplatStep<'_>,
        frame: &Observation,
        photograph: &Photograph,
        camera: &Camera,
        gain: [f32; 3],
    ) -> (Vec<u32>, Option<ComparedPhotograph>) {
        let camera = photograph.camera(&camera.pose);
        let near = near_plane_for(nearest(&frame.points));
        let pixels = photograph.colors.data.len();
        let per_depth_pixel = pixels_for_each(&frame.camera.intrinsics, photograph);
        let rule = step.rule;
        let rows = RowSubset::new(rule.row_stride(pixels, per_depth_pixel), scene.frames);
        let margin = frame.tolerance.margin;
        if rule.shuffle_buffer == 0 {
            let pixels = photograph.measured_pixels(gain, margin);
            let (outlier_factor, frame) = (CONTRADICTION, scene.frames);
            let view = TrainingView { camera, near, rows, outlier_factor, per_depth_pixel, frame };
            let (changed, outcome) = self.learner.learn(&view, &pixels, step);
            return (changed, outcome.map(|outcome| compared_now(scene, outcome)));
        }
        let rows = [rows.stride(), rows.first()];
        let view = PhotographView::new(scene.frames, &camera, gain, near, rows);
        let buffered = packed(PhotographView { per_depth_pixel, ..view }, photograph, margin);
        let most = rule.most_waiting(buffered.bytes());
        self.learner.state.buffered.push(buffered);
        self.learner.train_on_buffered_beyond(most, step)
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
