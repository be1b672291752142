//! Learning from the photograph: after the points, one Gauss-Newton step on the picture, with a
//! precision per splat that accumulates.
#![doc = include_str!("photometric.md")]

pub mod agreement;
mod comparers;
mod noise;
pub mod rule;
mod step;

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::simd::Isa;
use crate::model::scene::photometric::PhotometricState;
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::splats::Splat;
use crate::render::cpu::photometric::{
    Compared, PhotometricComparer, PixelRule, RowChoice, SeenSplat,
};
use crate::train::comparer_use::ComparerUse;
use crate::train::device_trial::DevicePolicy;
use crate::train::outcome::PhotographOutcome;
use crate::train::timing::Stopwatch;
use agreement::FrameAgreement;
use comparers::Comparers;
use rayon::prelude::*;
use rule::PhotometricRule;
pub use step::{LEAST_OPACITY, prior_precision};
use step::{LearnRun, SplatRun};

/// Weight of a splat over the pixels from which on a photograph says anything of it, px.
const MIN_SEEN: f32 = 0.5;
/// Components per parallel task.
const MIN_TASK: usize = 512;

/// Splats that learn from photographs, and the memory for it.
#[derive(Default)]
pub struct PhotometricLearner {
    state: PhotometricState,
    comparers: Comparers,
    repaired: u64,
}

impl PhotometricLearner {
    /// One that goes on.
    pub fn restore(state: PhotometricState) -> Self {
        Self { state, ..Self::default() }
    }

    /// Precisions that had to be taken back to the prior's, since training began or went on.
    pub fn repaired(&self) -> u64 {
        self.repaired
    }

    /// Compares photographs on a device too from now on.
    pub fn compare_on(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.comparers.add(comparer, policy);
    }

    /// What photographs were compared on.
    pub fn comparer_use(&self) -> ComparerUse {
        self.comparers.used()
    }

    /// Compares what is farther than so many world units from now on.
    pub fn set_near(&mut self, near: f64) {
        self.comparers.set_near(near);
    }

    /// What it has learnt.
    pub fn state(&self) -> &PhotometricState {
        &self.state
    }

    /// Splat and appearance of a component, if it has any.
    pub fn splat(&self, component: usize) -> Option<(Splat, Appearance)> {
        let has = self.state.has(component);
        has.then(|| (self.state.splats[component], self.state.appearance[component]))
    }

    /// Gives components that have none, or are young yet, the splats that points make, as far as these can
    /// be drawn. `points` and `splat` are those of a component.
    pub fn begin(
        &mut self,
        n_components: usize,
        touched: &[u32],
        rule: &PhotometricRule,
        points: impl Fn(usize) -> f64 + Sync,
        splat: impl Fn(usize) -> (Splat, Appearance) + Sync,
    ) {
        self.state.grow(n_components);
        let begins = |id: usize| !self.state.has(id) || points(id) < rule.young;
        let new = touched.par_iter().filter(|&&id| begins(id as usize));
        let new: Vec<(u32, (Splat, Appearance))> =
            new.map(|&id| (id, splat(id as usize))).filter(|(_, s)| s.0.is_drawable()).collect();
        let mut run = self.run();
        for (id, (splat, appearance)) in new {
            run.begin(id as usize, splat, appearance, &rule.prior);
        }
    }

    /// Forgets a component's splat.
    pub fn forget(&mut self, component: usize) {
        if let Some(splat) = self.state.splats.get_mut(component) {
            *splat = Splat::default();
        }
    }

    /// Judges a frame by its points before anything of it is learnt; `None` unless it contradicts the
    /// scene.
    pub fn judge(&mut self, agreement: &FrameAgreement) -> Option<PhotographOutcome> {
        noise::judge_points(&mut self.state, agreement)
    }

    /// Learns from a photograph taken by `camera`, unless that contradicts the scene. Gives which splats
    /// it changed, and how it compared.
    pub fn learn(
        &mut self,
        camera: &Camera,
        photograph: &Image<[f32; 4]>,
        full_coverage: f32,
        rule: &PhotometricRule,
    ) -> (Vec<u32>, Option<PhotographOutcome>) {
        let PhotometricState { splats, appearance, .. } = &self.state;
        let Some(view) = SplatView::new(splats, appearance) else { return (Vec::new(), None) };
        let (tau, coverage) = (rule.tau as f32, rule.coverage as f32);
        let pixels = PixelRule { full_coverage, tau, coverage };
        let rows = RowChoice::new(rule.rows_of(photograph.data.len()), self.state.noise[1] as u64);
        let every = rows.every();
        let mut comparers = std::mem::take(&mut self.comparers);
        let compared = comparers.compare(view, camera, photograph, pixels, rows);
        let clock = Stopwatch::start();
        let noise = &mut self.state.noise;
        let outcome = noise::judge(noise, compared.squared_error, compared.pixels);
        let deviation = rule.noise * noise::usual(noise);
        let mut seen = compared.seen(MIN_SEEN / every as f32);
        if outcome.is_some_and(|outcome| outcome.contradiction.is_some()) {
            seen.clear();
        }
        // A row stands for those that are left out.
        let variance = deviation * deviation / f64::from(every);
        self.repaired += self.step(&compared, &seen, variance, rule);
        comparers.stepped(clock.elapsed_ms());
        self.comparers = comparers;
        (seen.into_iter().map(|seen| seen.id).collect(), outcome)
    }

    /// Steps of all splats that are seen; how many had to be repaired.
    fn step(
        &mut self,
        compared: &Compared<'_>,
        seen: &[SeenSplat],
        variance: f64,
        rule: &PhotometricRule,
    ) -> u64 {
        let PhotometricState { splats, appearance, form, color, .. } = &mut self.state;
        let shapes = splats.par_chunks_mut(MIN_TASK).zip(form.par_chunks_mut(MIN_TASK));
        let colors = appearance.par_chunks_mut(MIN_TASK).zip(color.par_chunks_mut(MIN_TASK));
        let isa = Isa::best();
        let repaired = shapes.zip(colors).enumerate().with_max_len(1).map(
            |(task, ((splats, form), (appearance, color)))| {
                let (first, end) = (task * MIN_TASK, (task + 1) * MIN_TASK);
                let before = |end: usize| seen.partition_point(|seen| (seen.id as usize) < end);
                let run = SplatRun { first, splats, appearance, form, color };
                let seen = &seen[before(first)..before(end)];
                isa.run(LearnRun { run, compared, seen, variance, rule })
            },
        );
        repaired.sum()
    }

    fn run(&mut self) -> SplatRun<'_> {
        let PhotometricState { splats, appearance, form, color, .. } = &mut self.state;
        SplatRun { first: 0, splats, appearance, form, color }
    }
}
