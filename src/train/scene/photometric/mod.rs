//! Photometric training: after the points of a frame have been added, one Gauss-Newton step fits the
//! splats to its photograph. The precision of every splat accumulates over the frames.
#![doc = include_str!("../../../../docs/design/photographs.md")]

pub(in crate::train::scene) mod agreement;
mod camera_motion;
mod comparers;
pub mod rule;
mod step;
pub(in crate::train::scene) mod waiting;

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use crate::math::rng::Rng;
use crate::math::simd::Isa;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::waiting::BufferedPhotograph;
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::pose_log::FramePose;
use crate::model::splat::splats::Splat;
use crate::render::cpu::CpuRenderer;
use crate::render::cpu::photometric::{PhotometricSums, PixelRule, VisibleSplat};
use crate::train::learner::Changed;
use crate::train::outcome::{ComparedPhotograph, PhotographOutcome};
use crate::train::scene::textures::TextureLearner;
use crate::train::timing::Stopwatch;
use camera_motion::aligned_pose;
use comparers::Comparers;
use rayon::prelude::*;
use rule::PhotometricRule;
use step::{LearnRun, SplatRun};

#[cfg(test)]
pub(in crate::train::scene) use camera_motion::fixtures;
pub(in crate::train::scene) use comparers::TrainingView;
pub(in crate::train::scene) use step::{LEAST_OPACITY, PointExtents, is_trained, prior_precision};

/// Minimum blending weight of a splat, summed over pixels, for a photometric step.
const MIN_SEEN: f32 = 0.5;
/// Number of components per task that initialises splats. It is small, since the components with points
/// in a frame have neighbouring numbers.
const BEGUN_BY_TASK: usize = 64;
/// Number of components per task that takes photometric steps of splats.
const LEARNT_BY_TASK: usize = 256;

/// Parameters of the photometric steps of a scene's splats.
#[derive(Clone, Copy)]
pub(in crate::train::scene) struct SplatStep<'a> {
    pub rule: &'a PhotometricRule,
    pixels: PixelRule,
    /// Function that returns mean and extent of a component's points, which limit the position and size
    /// of the component's splat.
    extents: &'a PointExtents<'a>,
    /// Prior standard deviations of a photograph's rotation (radians) and position (world units) about the pose of its
    /// points; `None` for exact poses.
    pose_deviations: Option<[f64; 2]>,
}

impl<'a> SplatStep<'a> {
    /// Creates the parameters. A pixel is treated as fully covered if its coverage is at least
    /// `full_coverage`.
    pub fn new(
        full_coverage: f64,
        rule: &'a PhotometricRule,
        extents: &'a PointExtents<'a>,
        pose_deviations: Option<[f64; 2]>,
    ) -> Self {
        let values = [full_coverage, rule.tau, rule.coverage, rule.depth];
        let [full_coverage, tau, coverage, depth] = values.map(|value| value as f32);
        let pixels = PixelRule { full_coverage, tau, coverage, depth };
        Self { rule, pixels, extents, pose_deviations }
    }
}

/// Photometric state of a scene, with the devices and buffers for training it.
pub(in crate::train::scene) struct PhotometricLearner {
    pub state: PhotometricState,
    pub comparers: Comparers,
    pub textures: TextureLearner,
    /// Time spent on textures since the frame began, milliseconds.
    pub texture_ms: f64,
    /// Renderer of the pictures with which photographs are aligned.
    renderer: CpuRenderer,
    /// Latest photograph unpacked from the shuffle buffer; its memory is reused.
    image: Image<MeasuredPixel>,
    /// Number of times that a splat's precision was reset to the prior since training began or resumed.
    pub repaired: u64,
}

/// A photograph to take the photometric step for.
pub(in crate::train::scene) struct AlignedPhotograph {
    /// View from the photograph's own pose.
    pub view: TrainingView,
    /// Pose of the frame's points; `None` if it is that of the view.
    of_points: Option<Pose>,
    pixels: Image<MeasuredPixel>,
}

impl Default for PhotometricLearner {
    fn default() -> Self {
        Self::restore(PhotometricState::default())
    }
}

impl PhotometricLearner {
    /// Resumes photometric training from a state.
    pub fn restore(state: PhotometricState) -> Self {
        let image = Image::filled(0, 0, MeasuredPixel::UNKNOWN);
        let (textures, comparers) = (TextureLearner::default(), Comparers::default());
        let renderer = CpuRenderer::new();
        Self { state, comparers, textures, texture_ms: 0.0, renderer, image, repaired: 0 }
    }

    /// Initialises the splats of the components in `touched` from their points. A splat is kept if its
    /// component has many points and the splat was trained on a photograph. Splats that cannot be drawn
    /// are skipped. `points` returns the number of a component's points, `splat` the splat derived from
    /// its points.
    pub fn initialise_splats(
        &mut self,
        n_components: usize,
        touched: &[u32],
        rule: &PhotometricRule,
        points: impl Fn(usize) -> f64 + Sync,
        splat: impl Fn(usize) -> (Splat, Appearance) + Sync,
    ) {
        self.state.grow(n_components);
        self.runs(BEGUN_BY_TASK).for_each(|mut run| {
            for &id in run.own(touched, |id| *id) {
                let (id, row) = (id as usize, id as usize - run.first);
                let begins = !run.has(row)
                    || points(id) < rule.young
                    || !is_trained(&run.color[row], &rule.prior);
                let begun = begins.then(|| splat(id)).filter(|(splat, _)| splat.is_drawable());
                if let Some((splat, appearance)) = begun {
                    run.begin(row, splat, appearance, &rule.prior);
                }
            }
        });
    }

    /// Sets the range of view directions from which changed components were observed. `observed` returns
    /// that range for one component.
    pub fn observe(
        &mut self,
        changed: Changed<'_>,
        observed: impl Fn(usize) -> ObservedCone + Sync,
    ) {
        self.runs(LEARNT_BY_TASK).for_each(|run| match changed {
            Changed::Listed(ids) => {
                for &id in run.own(ids, |id| *id) {
                    run.appearance[id as usize - run.first].observed = observed(id as usize);
                }
            }
            Changed::All => {
                for (row, look) in run.appearance.iter_mut().enumerate() {
                    look.observed = observed(run.first + row);
                }
            }
        });
    }

    /// If the buffer holds more than `most` photographs, removes and aligns one at random.
    pub fn draw_beyond(&mut self, most: usize, step: &SplatStep<'_>) -> Option<AlignedPhotograph> {
        // Filled first: a draw among few photographs would be one of the latest.
        if self.state.buffered.len() <= most {
            return None;
        }
        let mut draws = waiting::buffer_rng(&self.state.buffered);
        self.draw(&mut draws, step)
    }

    /// Returns the state after the photometric steps for all buffered photographs, and the comparisons
    /// with these photographs. The learner's own state does not change.
    pub fn settled_state(
        &mut self,
        step: &SplatStep<'_>,
    ) -> (PhotometricState, Vec<ComparedPhotograph>) {
        let (before, repaired) = (self.state.clone(), self.repaired);
        self.comparers.begin_settling();
        let mut draws = waiting::buffer_rng(&self.state.buffered);
        let mut compared = Vec::new();
        while !self.state.buffered.is_empty() {
            let drawn = self.draw(&mut draws, step);
            compared.extend(drawn.and_then(|drawn| self.learn(drawn, step).1));
        }
        // These steps are taken back, so their repairs do not count.
        self.repaired = repaired;
        (std::mem::replace(&mut self.state, before), compared)
    }

    fn draw(&mut self, draws: &mut Rng, step: &SplatStep<'_>) -> Option<AlignedPhotograph> {
        self.estimate_usual_residual(step.pixels);
        let drawn = draws.below(self.state.buffered.len());
        let drawn = self.state.buffered.swap_remove(drawn);
        self.aligned_from_buffer(&drawn, step)
    }

    /// Estimates the usual residual from a few buffered photographs before the first step, so that even
    /// early outliers are detected.
    fn estimate_usual_residual(&mut self, pixels: PixelRule) {
        let Self { state, comparers, image, .. } = self;
        let n = state.buffered.len();
        if waiting::is_known(&state.noise) || n < waiting::SETTLED as usize {
            return;
        }
        let Some(splats) = SplatView::new(&state.splats, &state.appearance) else { return };
        let mut differences = Vec::new();
        for few in 0..waiting::SETTLED as usize {
            let photograph = &state.buffered[few * n / waiting::SETTLED as usize];
            let Some(view) = waiting::unpacked(photograph, image) else { continue };
            let compared = comparers.compare(splats, &view, image, pixels);
            differences.extend(waiting::difference(compared.squared_error, compared.pixels));
        }
        waiting::init_running_mean(&mut state.noise, differences);
    }

    /// Takes the photometric step for a photograph unless the photograph is an outlier. Returns the
    /// changed splats, and the comparison of the photograph with the scene.
    pub fn learn(
        &mut self,
        photograph: AlignedPhotograph,
        step: &SplatStep<'_>,
    ) -> (Vec<u32>, Option<ComparedPhotograph>) {
        let (changed, outcome) = self.step_of(&photograph, step);
        let frame = photograph.view.frame;
        self.image = photograph.pixels;
        (changed, outcome.map(|outcome| ComparedPhotograph { frame, outcome }))
    }

    fn step_of(
        &mut self,
        AlignedPhotograph { view, of_points, pixels }: &AlignedPhotograph,
        step: &SplatStep<'_>,
    ) -> (Vec<u32>, Option<PhotographOutcome>) {
        if self.state.has_textures() {
            let clock = Stopwatch::start();
            self.textures.judge(&mut self.state, view, pixels);
            self.texture_ms += clock.elapsed_ms();
        }
        let PhotometricState { splats, appearance, .. } = &self.state;
        let Some(splats) = SplatView::new(splats, appearance) else { return (Vec::new(), None) };
        let every = view.rows.stride();
        // Taken out of `self`: the sums borrow it while the splats are changed.
        let mut comparers = std::mem::take(&mut self.comparers);
        let compared = comparers.compare(splats, view, pixels, step.pixels);
        let clock = Stopwatch::start();
        let noise = &mut self.state.noise;
        let outcome =
            waiting::judge(noise, compared.squared_error, compared.pixels, view.outlier_factor);
        let deviation = step.rule.noise * waiting::usual(noise);
        // Weights sum over the compared rows only, one of `every`.
        let mut seen = compared.visible_splats(MIN_SEEN / every as f32);
        if outcome.is_some_and(|outcome| outcome.contradiction.is_some()) {
            seen.clear();
        } else if let Some(of_points) = of_points {
            self.state.photograph_poses.push(FramePose::new(of_points, &view.camera.pose));
        }
        // A row represents those left out. The pixels of one depth pixel count as one, since their residuals
        // share surface point, pose and exposure.
        let variance = deviation * deviation * view.per_depth_pixel / f64::from(every);
        self.repaired += self.step(&compared, &seen, variance, step);
        comparers.count_step(clock.elapsed_ms());
        self.comparers = comparers;
        (seen.into_iter().map(|seen| seen.id).collect(), outcome)
    }

    /// Aligns a photograph with the scene, from the pose of the points in `view`.
    pub fn aligned(
        &mut self,
        view: TrainingView,
        pixels: Image<MeasuredPixel>,
        step: &SplatStep<'_>,
    ) -> AlignedPhotograph {
        match self.own_pose(&view, &pixels, step) {
            None => AlignedPhotograph { view, of_points: None, pixels },
            Some(pose) => {
                let of_points = Some(view.camera.pose);
                let view = TrainingView { camera: Camera { pose, ..view.camera }, ..view };
                AlignedPhotograph { view, of_points, pixels }
            }
        }
    }

    fn aligned_from_buffer(
        &mut self,
        photograph: &BufferedPhotograph,
        step: &SplatStep<'_>,
    ) -> Option<AlignedPhotograph> {
        // Taken out of `self`, which alignment borrows mutably; `learn` puts it back.
        let mut pixels =
            std::mem::replace(&mut self.image, Image::filled(0, 0, MeasuredPixel::UNKNOWN));
        let view = waiting::unpacked(photograph, &mut pixels)?;
        Some(self.aligned(view, pixels, step))
    }

    /// Returns the pose from which a photograph fits the textured scene best; `None` if there are no textures or if
    /// that of the points is used.
    pub fn textured_pose_of(
        &mut self,
        photograph: &BufferedPhotograph,
        step: &SplatStep<'_>,
    ) -> Option<Pose> {
        if step.pose_deviations.is_none() || !self.state.has_textures() {
            return None;
        }
        let AlignedPhotograph { view, pixels, .. } = self.aligned_from_buffer(photograph, step)?;
        self.image = pixels;
        Some(view.camera.pose)
    }

    fn own_pose(
        &mut self,
        view: &TrainingView,
        photograph: &Image<MeasuredPixel>,
        step: &SplatStep<'_>,
    ) -> Option<Pose> {
        let deviations = step.pose_deviations?;
        let PhotometricState { splats, appearance, textures, .. } = &self.state;
        let mut splats = SplatView::new(splats, appearance)?;
        // Without textures the picture would lack fine detail, and motions would follow its blur.
        if self.state.has_textures() {
            splats = splats.with_learned(textures);
        }
        aligned_pose(&mut self.renderer, splats, view, photograph, deviations)
    }

    /// Takes the photometric step of all visible splats. Returns the number of splats whose precision
    /// was reset to the prior.
    fn step(
        &mut self,
        compared: &PhotometricSums<'_>,
        seen: &[VisibleSplat],
        variance: f64,
        SplatStep { rule, extents, .. }: &SplatStep<'_>,
    ) -> u64 {
        let isa = Isa::best();
        let repaired = self.runs(LEARNT_BY_TASK).map(|run| {
            let seen = run.own(seen, |seen| seen.id);
            isa.run(LearnRun { run, compared, seen, variance, rule, extents })
        });
        repaired.sum()
    }

    /// Splits all splats into runs of `n` consecutive splats, one run per task.
    fn runs(&mut self, n: usize) -> impl ParallelIterator<Item = SplatRun<'_>> {
        let PhotometricState { splats, appearance, form, color, .. } = &mut self.state;
        let shapes = splats.par_chunks_mut(n).zip(form.par_chunks_mut(n));
        let colors = appearance.par_chunks_mut(n).zip(color.par_chunks_mut(n));
        // One run per task: the visible splats may cluster in few runs.
        shapes.zip(colors).enumerate().with_max_len(1).map(
            move |(task, ((splats, form), (appearance, color)))| {
                let first = task * n;
                SplatRun { first, splats, appearance, form, color }
            },
        )
    }
}
