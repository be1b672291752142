//! Learning from the photograph: after the points, one Gauss-Newton step on the picture, with a
//! precision per splat that accumulates.
#![doc = include_str!("photometric.md")]

pub mod agreement;
mod comparers;
mod noise;
pub mod rule;
mod step;
pub mod waiting;

use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::math::pose::Pose;
use crate::math::rng::Rng;
use crate::math::simd::Isa;
use crate::model::scene::photometric::PhotometricState;
use crate::model::scene::waiting::WaitingPhotograph;
use crate::model::splat::appearance::{Appearance, SplatView};
use crate::model::splat::observed_cone::ObservedCone;
use crate::model::splat::splats::Splat;
use crate::render::cpu::photometric::{Compared, PhotometricComparer, PixelRule, SeenSplat};
use crate::train::comparer_use::ComparerUse;
use crate::train::device_trial::DevicePolicy;
use crate::train::outcome::{ComparedPhotograph, PhotographOutcome};
use crate::train::timing::Stopwatch;
use agreement::FrameAgreement;
use comparers::Comparers;
pub use comparers::LearntView;
pub use noise::CONTRADICTION;
use rayon::prelude::*;
use rule::PhotometricRule;
pub use step::PointExtents;
pub use step::{LEAST_OPACITY, is_taught, prior_precision};
use step::{LearnRun, SplatRun};

/// Weight of a splat over the pixels from which on a photograph says anything of it, px.
const MIN_SEEN: f32 = 0.5;
/// Components of a task that begins splats: those that a frame touches lie together.
const BEGUN_BY_TASK: usize = 64;
/// The same that learns, which takes eight of those that are seen at a time.
const LEARNT_BY_TASK: usize = 256;

fn pixel_rule(full_coverage: f32, rule: &PhotometricRule) -> PixelRule {
    let [tau, coverage, depth] = [rule.tau, rule.coverage, rule.depth].map(|value| value as f32);
    PixelRule { full_coverage, tau, coverage, depth }
}

/// Splats that learn from photographs, and the memory for it.
pub struct PhotometricLearner {
    state: PhotometricState,
    comparers: Comparers,
    /// A photograph that waited, in full.
    image: Image<MeasuredPixel>,
    repaired: u64,
}

impl Default for PhotometricLearner {
    fn default() -> Self {
        Self::restore(PhotometricState::default())
    }
}

impl PhotometricLearner {
    /// One that goes on.
    pub fn restore(state: PhotometricState) -> Self {
        let image = Image::filled(0, 0, MeasuredPixel::UNKNOWN);
        Self { state, comparers: Comparers::default(), image, repaired: 0 }
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

    /// Moves all that it has learnt, and is still to learn, with the world ([`PhotometricState::move_by`]).
    pub fn move_by(&mut self, motion: &Pose) {
        self.state.move_by(motion);
    }

    /// Moves the camera of a frame's photograph, if that still waits.
    pub fn move_photograph(&mut self, frame: u64, motion: &Pose) {
        let is_it = |waiting: &&mut WaitingPhotograph| waiting.view.frame == frame as f64;
        let waiting = self.state.waiting.iter_mut().filter(is_it);
        waiting.for_each(|waiting| waiting.view = waiting.view.moved(motion));
    }

    /// Frames come again: what was learnt to be drawn at rest is over.
    pub fn go_on(&mut self) {
        self.comparers.go_on();
    }

    /// What it has learnt.
    pub fn state(&self) -> &PhotometricState {
        &self.state
    }

    /// Gives components that have none, or are young yet, or that no photograph has taught, the splats that
    /// points make, as far as these can be drawn. `points` and `splat` are those of a component.
    pub fn begin(
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
                    || !is_taught(&run.color[row], &rule.prior);
                let begun = begins.then(|| splat(id)).filter(|(splat, _)| splat.is_drawable());
                if let Some((splat, appearance)) = begun {
                    run.begin(row, splat, appearance, &rule.prior);
                }
            }
        });
    }

    /// Sets the directions from which each component was observed.
    pub fn observe(&mut self, observed: impl Fn(usize) -> ObservedCone + Sync) {
        self.runs(LEARNT_BY_TASK).for_each(|run| {
            for (row, look) in run.appearance.iter_mut().enumerate() {
                look.observed = observed(run.first + row);
            }
        });
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

    /// Lets a photograph wait.
    pub fn put_off(&mut self, photograph: WaitingPhotograph) {
        self.state.waiting.push(photograph);
    }

    /// Learns from one of the photographs that wait, drawn at random, where more do than may.
    pub fn learn_one_beyond(
        &mut self,
        most: usize,
        full_coverage: f32,
        rule: &PhotometricRule,
        extents: &PointExtents<'_>,
    ) -> (Vec<u32>, Option<ComparedPhotograph>) {
        if self.state.waiting.len() <= most {
            return (Vec::new(), None);
        }
        let mut draws = waiting::draws(&self.state.waiting);
        self.learn_drawn(&mut draws, full_coverage, rule, extents)
    }

    /// What it will have learnt once nothing waits any more, and how what waits compares. It goes on as if
    /// it had not been asked.
    pub fn settled(
        &mut self,
        full_coverage: f32,
        rule: &PhotometricRule,
        extents: &PointExtents<'_>,
    ) -> (PhotometricState, Vec<ComparedPhotograph>) {
        let (before, repaired) = (self.state.clone(), self.repaired);
        self.comparers.come_to_rest();
        let mut draws = waiting::draws(&self.state.waiting);
        let mut compared = Vec::new();
        while !self.state.waiting.is_empty() {
            compared.extend(self.learn_drawn(&mut draws, full_coverage, rule, extents).1);
        }
        self.repaired = repaired;
        (std::mem::replace(&mut self.state, before), compared)
    }

    fn learn_drawn(
        &mut self,
        draws: &mut Rng,
        full_coverage: f32,
        rule: &PhotometricRule,
        extents: &PointExtents<'_>,
    ) -> (Vec<u32>, Option<ComparedPhotograph>) {
        self.see_what_is_usual(full_coverage, rule);
        let drawn = draws.below(self.state.waiting.len());
        let drawn = self.state.waiting.swap_remove(drawn);
        // Taken out meanwhile: learning from it needs all the rest.
        let mut image =
            std::mem::replace(&mut self.image, Image::filled(0, 0, MeasuredPixel::UNKNOWN));
        let unpacked = waiting::unpacked(&drawn, &mut image);
        let learnt = unpacked.map(|view| self.learn(&view, &image, full_coverage, rule, extents));
        self.image = image;
        let (changed, outcome) = learnt.unwrap_or_default();
        let frame = drawn.view.frame as u64;
        (changed, outcome.map(|outcome| ComparedPhotograph { frame, outcome }))
    }

    /// Before the first of the photographs that wait is learnt: how far a few of them differ says what is
    /// usual, so that not even the first ones are learnt blindly.
    fn see_what_is_usual(&mut self, full_coverage: f32, rule: &PhotometricRule) {
        let Self { state, comparers, image, .. } = self;
        let n = state.waiting.len();
        if noise::is_known(&state.noise) || n < noise::SETTLED as usize {
            return;
        }
        let Some(splats) = SplatView::new(&state.splats, &state.appearance) else { return };
        let mut differences = Vec::new();
        for few in 0..noise::SETTLED as usize {
            let waiting = &state.waiting[few * n / noise::SETTLED as usize];
            let Some(view) = waiting::unpacked(waiting, image) else { continue };
            let pixels = pixel_rule(full_coverage, rule);
            let compared = comparers.compare(splats, &view, image, pixels);
            differences.extend(noise::difference(compared.squared_error, compared.pixels));
        }
        noise::begin(&mut state.noise, differences);
    }

    /// Learns from a photograph, unless that contradicts the scene. Gives which splats it changed, and how
    /// it compared.
    pub fn learn(
        &mut self,
        view: &LearntView,
        photograph: &Image<MeasuredPixel>,
        full_coverage: f32,
        rule: &PhotometricRule,
        extents: &PointExtents<'_>,
    ) -> (Vec<u32>, Option<PhotographOutcome>) {
        let PhotometricState { splats, appearance, .. } = &self.state;
        let Some(splats) = SplatView::new(splats, appearance) else { return (Vec::new(), None) };
        let every = view.rows.every();
        let mut comparers = std::mem::take(&mut self.comparers);
        let pixels = pixel_rule(full_coverage, rule);
        let compared = comparers.compare(splats, view, photograph, pixels);
        let clock = Stopwatch::start();
        let noise = &mut self.state.noise;
        let outcome =
            noise::judge(noise, compared.squared_error, compared.pixels, view.contradicts_from);
        let deviation = rule.noise * noise::usual(noise);
        let mut seen = compared.seen(MIN_SEEN / every as f32);
        if outcome.is_some_and(|outcome| outcome.contradiction.is_some()) {
            seen.clear();
        }
        // A row stands for those that are left out, and the pixels of a depth pixel count as one:
        // their differences come from the same surface point, pose and exposure.
        let variance = deviation * deviation * view.per_depth_pixel / f64::from(every);
        self.repaired += self.step(&compared, &seen, variance, rule, extents);
        comparers.learnt(clock.elapsed_ms());
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
        extents: &PointExtents<'_>,
    ) -> u64 {
        let isa = Isa::best();
        let repaired = self.runs(LEARNT_BY_TASK).map(|run| {
            let seen = run.own(seen, |seen| seen.id);
            isa.run(LearnRun { run, compared, seen, variance, rule, extents })
        });
        repaired.sum()
    }

    /// All splats in runs of so many, one a task.
    fn runs(&mut self, n: usize) -> impl ParallelIterator<Item = SplatRun<'_>> {
        let PhotometricState { splats, appearance, form, color, .. } = &mut self.state;
        let shapes = splats.par_chunks_mut(n).zip(form.par_chunks_mut(n));
        let colors = appearance.par_chunks_mut(n).zip(color.par_chunks_mut(n));
        shapes.zip(colors).enumerate().with_max_len(1).map(
            move |(task, ((splats, form), (appearance, color)))| {
                let first = task * n;
                SplatRun { first, splats, appearance, form, color }
            },
        )
    }
}
