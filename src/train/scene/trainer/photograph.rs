//! What the trainer does with a frame's photograph: judges the frame before it is learnt, and learns
//! from the picture after the points.

use super::{EVERYTHING_EVERY, SceneTrainer};
use crate::math::camera::Camera;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::render::following_near;
use crate::train::outcome::{FrameOutcome, PhotographOutcome};
use crate::train::scene::component_sums::SumScalar;
use crate::train::scene::photometric::agreement::FrameBesideScene;
use crate::train::scene::seed_positions::SeedPositions;
use crate::train::stages::{SCENE_STAGES, SceneStage};
use crate::train::timing::{StageMs, Stopwatch};

/// Points looked at for how near a frame's surfaces are: every so many.
const NEAREST_OF: usize = 16;
/// Share of them that may be nearer than that.
const NEARER: f64 = 0.02;

/// Distance that nearly all points of a frame are beyond, world units; 0 without points.
fn nearest(points: &[SurfacePoint]) -> f64 {
    let mut ranges: Vec<f32> = points.iter().step_by(NEAREST_OF).map(|p| p.range).collect();
    let at = (ranges.len() as f64 * NEARER) as usize;
    match ranges.is_empty() {
        true => 0.0,
        false => f64::from(*ranges.select_nth_unstable_by(at, f32::total_cmp).1),
    }
}

impl<W: SumScalar> SceneTrainer<W> {
    /// Learns from the photograph of a frame whose points are known, unless it contradicts the scene.
    pub fn train_on_photograph(&mut self, frame: &Observation) -> FrameOutcome {
        let wall = Stopwatch::start();
        let mut ms = StageMs::new(&SCENE_STAGES);
        let mut clock = Stopwatch::start();
        let (moved, camera) = self.moved(frame);
        let points = moved.as_deref().unwrap_or(&frame.points);
        ms.add(SceneStage::Pose as usize, clock.lap_ms());
        self.assign(points);
        let gain = self.gain(points, frame.point_weight);
        let contradiction = self.contradiction(frame, &camera, points, gain);
        ms.add(SceneStage::Assign as usize, clock.lap_ms());
        self.pass_over();
        let photograph = match contradiction {
            None => self.learn_photograph(frame, &camera, gain),
            contradiction => contradiction,
        };
        ms.add(SceneStage::Photometric as usize, clock.lap_ms());
        self.moved = moved.unwrap_or_default();
        ms.train = wall.elapsed_ms();
        FrameOutcome { photograph, ms, ..FrameOutcome::default() }
    }

    /// Whether a frame's points contradict the scene, asked only where photographs are learnt: without
    /// them scenes keep the bits that they had before frames were judged.
    pub(super) fn contradiction(
        &mut self,
        frame: &Observation,
        camera: &Camera,
        points: &[SurfacePoint],
        gain: [f32; 3],
    ) -> Option<PhotographOutcome> {
        self.config.photometric?;
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
        let agreement = comparison.agreement();
        self.photometric.judge(&agreement)
    }

    /// Counts a frame of whose points nothing is learnt.
    pub(super) fn pass_over(&mut self) {
        self.frames += 1;
        self.touched.clear();
        self.has_changed_all = self.frames.is_multiple_of(EVERYTHING_EVERY);
    }

    /// The step that the frame's photograph asks of the splats.
    pub(super) fn learn_photograph(
        &mut self,
        frame: &Observation,
        camera: &Camera,
        gain: [f32; 3],
    ) -> Option<PhotographOutcome> {
        let (rule, photograph) = (self.config.photometric_rule()?, frame.photograph.as_ref()?);
        // Taken out meanwhile: new splats are made of the sums that stay behind.
        let mut photometric = std::mem::take(&mut self.photometric);
        let splat = |id| self.splat_of_points(id);
        let points = |id| self.component_sums.plane_sums(id).0;
        photometric.begin(self.component_sums.len(), &self.touched, &rule, points, splat);
        let full_coverage = self.config.splat_rule.full_coverage as f32;
        let exposed = photograph.exposed(gain);
        let pixels = exposed.as_ref().unwrap_or(&photograph.pixels);
        let camera = photograph.camera(&camera.pose);
        photometric.set_near(following_near(nearest(&frame.points)));
        let (changed, outcome) = photometric.learn(&camera, pixels, full_coverage, &rule);
        self.photometric = photometric;
        self.touched.extend(changed);
        self.touched.sort_unstable();
        self.touched.dedup();
        outcome
    }
}
