//! Photometric part of the trainer: outlier test of a frame before training on it, and the photometric step
//! after its points.

use super::{EVERYTHING_EVERY, SceneTrainer};
use crate::math::camera::{Camera, Intrinsics};
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::waiting::PhotographView;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::render::cpu::photometric::RowSubset;
use crate::render::near_plane_for;
use crate::train::outcome::{ComparedPhotograph, FrameOutcome, PhotographOutcome};
use crate::train::scene::components::SeedPositions;
use crate::train::scene::photometric::agreement::FrameBesideScene;
use crate::train::scene::photometric::waiting::packed;
use crate::train::scene::photometric::{CONTRADICTION, PhotometricLearner, TrainingView};
use crate::train::timing::{SCENE_STAGES, SceneStage, StageMs, Stopwatch};

// Stride over the points to estimate the distance of a frame's nearest surfaces.
const NEAREST_OF: usize = 16;
/// Share of points that may be nearer than the estimate.
const NEARER: f64 = 0.02;

/// Distance that nearly all points of a frame exceed, world units; 0 without points.
fn nearest(points: &[SurfacePoint]) -> f64 {
    let mut ranges: Vec<f32> = points.iter().step_by(NEAREST_OF).map(|p| p.range).collect();
    let at = (ranges.len() as f64 * NEARER) as usize;
    match ranges.is_empty() {
        true => 0.0,
        false => f64::from(*ranges.select_nth_unstable_by(at, f32::total_cmp).1),
    }
}

/// Pixels of a photograph per pixel of its depth image, at least 1.
fn pixels_for_each(depth: &Intrinsics, pixels: usize) -> f64 {
    let depth = f64::from(depth.width) * f64::from(depth.height);
    (pixels as f64 / depth).max(1.0)
}

impl SceneTrainer {
    /// Trains on the photograph of a frame whose points were added in an earlier pass, unless it is an
    /// outlier.
    pub fn train_on_photograph(&mut self, frame: &Observation) -> FrameOutcome {
        let was_settled = self.drop_settled();
        let wall = Stopwatch::start();
        let mut ms = StageMs::new(&SCENE_STAGES);
        let mut clock = Stopwatch::start();
        let (moved, camera) = self.aligned_points(frame);
        let points = moved.as_deref().unwrap_or(&frame.points);
        ms.add(SceneStage::Pose as usize, clock.lap_ms());
        self.fits.begin_untimed_frame();
        self.assign(points);
        let gain = self.gain(points, frame.point_weight);
        let contradicts = self.is_outlier(frame, &camera, points, gain);
        ms.add(SceneStage::Assign as usize, clock.lap_ms());
        self.touched.clear();
        if !contradicts {
            self.learn_photograph(frame, &camera, gain);
        }
        self.end_frame(moved, was_settled);
        ms.add(SceneStage::Photometric as usize, clock.lap_ms());
        ms.train = wall.elapsed_ms();
        FrameOutcome { ms, ..FrameOutcome::default() }
    }

    /// True if a frame's points show it to be an outlier. Tested only with photometric training, so that
    /// scenes without it keep the bits of earlier versions.
    pub(super) fn is_outlier(
        &mut self,
        frame: &Observation,
        camera: &Camera,
        points: &[SurfacePoint],
        gain: [f32; 3],
    ) -> bool {
        if self.config.photometric.is_none() {
            return false;
        }
        let comparison = FrameBesideScene {
            component_sums: &self.component_sums,
            seed_positions: SeedPositions { grid: &self.grid, components: &self.components },
            h: self.config.h,
            frame,
            camera,
            points,
            owners: &self.owners,
            gain,
        };
        let outcome = self.photometric.check_points(&comparison.agreement());
        self.compared.extend(outcome.map(|outcome| self.compared_photograph(outcome)));
        outcome.is_some()
    }

    fn compared_photograph(&self, outcome: PhotographOutcome) -> ComparedPhotograph {
        ComparedPhotograph { frame: self.frames, outcome }
    }

    /// Counts a frame, whether trained on or skipped, records whether all components changed, and takes back
    /// the buffer of its points.
    pub(super) fn end_frame(&mut self, moved: Option<Vec<SurfacePoint>>, has_changed_all: bool) {
        self.moved = moved.unwrap_or_default();
        self.frames += 1;
        self.has_changed_all = has_changed_all || self.frames.is_multiple_of(EVERYTHING_EVERY);
    }

    /// Takes the photometric step for a frame, if enabled.
    pub(super) fn learn_photograph(
        &mut self,
        frame: &Observation,
        camera: &Camera,
        gain: [f32; 3],
    ) {
        // Taken out of `self`, which is borrowed to make new splats from the sums.
        let mut photometric = std::mem::take(&mut self.photometric);
        let learned = self.step_of_photograph(&mut photometric, frame, camera, gain);
        self.photometric = photometric;
        let (changed, compared) = learned.unwrap_or_default();
        self.compared.extend(compared);
        self.mark_changed(&changed);
    }

    /// Adds components, ascending, to those changed by the frame.
    fn mark_changed(&mut self, changed: &[u32]) {
        self.touched.extend_from_slice(changed);
        // A stable sort, which merges the two sorted runs.
        self.touched.sort();
        self.touched.dedup();
    }

    /// Initialises the splats of new components, then takes the step of the frame's photograph, or buffers it
    /// and takes the step of a buffered one. Returns the changed splats and the comparison.
    fn step_of_photograph(
        &self,
        photometric: &mut PhotometricLearner,
        frame: &Observation,
        camera: &Camera,
        gain: [f32; 3],
    ) -> Option<(Vec<u32>, Option<ComparedPhotograph>)> {
        let rule = self.config.photometric_rule()?;
        let photograph = frame.photograph.as_ref()?;
        let splat = |id| self.splat_of_points(id);
        let points = |id| self.component_sums.plane_sums(id).0;
        photometric.initialise_splats(
            self.component_sums.len(),
            &self.touched,
            &rule,
            points,
            splat,
        );
        photometric.observe(|id| self.component_sums.observed_cone(id));
        let full_coverage = self.config.splat_rule.full_coverage as f32;
        let camera = photograph.camera(&camera.pose);
        let near = near_plane_for(nearest(&frame.points));
        let pixels = photograph.colors.data.len();
        let per_depth_pixel = pixels_for_each(&frame.camera.intrinsics, pixels);
        let every = rule.row_stride(pixels, per_depth_pixel);
        let rows = RowSubset::new(every, self.frames);
        let margin = frame.tolerance.margin;
        let extent = |id| self.point_extent(id);
        Some(if rule.shuffle_buffer == 0 {
            let pixels = photograph.measured_pixels(gain, margin);
            let contradicts_from = CONTRADICTION;
            let view = TrainingView {
                camera,
                near,
                rows,
                outlier_factor: contradicts_from,
                per_depth_pixel,
            };
            let (changed, outcome) =
                photometric.learn(&view, &pixels, full_coverage, &rule, &extent);
            (changed, outcome.map(|outcome| self.compared_photograph(outcome)))
        } else {
            let rows = [rows.stride(), rows.first()];
            let view = PhotographView::new(self.frames, &camera, gain, near, rows);
            let view = PhotographView { per_depth_pixel, ..view };
            let waiting = packed(view, photograph, margin);
            let most = rule.most_waiting(waiting.bytes());
            photometric.buffer_photograph(waiting);
            photometric.train_on_buffered_beyond(most, full_coverage, &rule, &extent)
        })
    }

    /// Resumes training: drops the settled state. Returns true if there was one.
    pub(super) fn drop_settled(&mut self) -> bool {
        self.compared.clear();
        self.photometric.resume();
        self.settled.take().is_some()
    }

    /// Computes the state after steps for all buffered photographs. Returns true if there were any.
    pub(super) fn settle_photographs(&mut self) -> bool {
        let Some(rule) = self.config.photometric_rule() else { return false };
        if self.settled.is_some() || self.photometric.state().buffered.is_empty() {
            return false;
        }
        let full_coverage = self.config.splat_rule.full_coverage as f32;
        // Taken out of `self`, which is borrowed to read extents from the sums.
        let mut photometric = std::mem::take(&mut self.photometric);
        photometric.observe(|id| self.component_sums.observed_cone(id));
        let extent = |id| self.point_extent(id);
        let (settled, compared) = photometric.settled_state(full_coverage, &rule, &extent);
        self.photometric = photometric;
        self.settled = Some(settled);
        self.compared = compared;
        self.has_changed_all = true;
        true
    }

    /// Returns the state after steps for all buffered photographs, if there are any.
    pub(in crate::train::scene) fn settled_photographs(mut self) -> Option<PhotometricState> {
        self.settle_photographs();
        self.settled
    }

    /// Returns the photometric state for drawing.
    pub(super) fn drawn_state(&self) -> &PhotometricState {
        self.settled.as_ref().unwrap_or_else(|| self.photometric.state())
    }
}
