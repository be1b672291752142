//! The trainer of one precision: owns the model and applies frames to it.
//!
//! Frames are scored against the initial model, never the posterior (`model.md`, Three models), so
//! that their sums simply add. What can fail, the index, is built before anything is added or after
//! all of it: a frame counts whole or not at all.

use super::config::{Candidates, PaperConfig, ReassignPolicy};
use super::index::Index;
use super::init::InitialDraw;
use super::pass::{Output, Pass, PassInputs};
use super::passes::Passes;
use super::reassign::{DestinationChooser, Quota};
use super::scalar::PaperScalar;
use crate::math::rng::{Purpose, Rng};
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::conjugate::prior::Hyper;
use crate::model::conjugate::statistics::Moments;
use crate::model::device_error::DeviceError;
use crate::model::paper::mixture::InitialModel;
use crate::model::paper::mixture_device::MixtureDevice;
use crate::model::paper::state::ModelState;
use crate::model::paper::totals::Statistics;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::device_trial::DevicePolicy;
use crate::train::estep::Scoring;
use crate::train::outcome::FrameOutcome;
use crate::train::pass_use::PassUse;
use crate::train::stages::{PAPER_STAGES, PaperStage};
use crate::train::timing::{StageMs, Stopwatch};
use glam::DVec3;
use rayon::prelude::*;

/// Effective distances that are summed by themselves before their sums are.
const SUMMED: usize = 64;
/// Sums that a task forms at least.
const SUMS: usize = 128;

/// Model and buffers in precision `R`.
pub struct PaperTrainer<R: PaperScalar> {
    config: PaperConfig,
    hyper: Hyper,
    model: InitialModel<R>,
    alpha_init: Vec<f64>,
    index: Index,
    scoring: Scoring,
    statistics: Statistics,
    passes: Passes,
    /// Effective distance of every point of the last frame.
    q: Vec<f64>,
    /// Sums of these, and of how many.
    q_sums: Vec<(f64, usize)>,
    component_elbo: ComponentElbo,
    chooser: DestinationChooser,
    moves: Vec<(u32, u32)>,
    /// Positions and colours that components of a reassignment came from, should it fail.
    displaced: Vec<([R; 3], [R; 3])>,
    /// Where they came from and went to.
    places: Vec<[f32; 3]>,
    frames: u64,
}

impl<R: PaperScalar> PaperTrainer<R> {
    /// A model that has seen nothing. `draw` holds one mean and one weight per component.
    pub fn new(config: &PaperConfig, draw: &InitialDraw) -> Result<Self, IndexError> {
        Self::with_hyper(config, config.hyper(), draw)
    }

    /// The same with hyper-parameters of one's own instead of the preset's.
    pub fn with_hyper(
        config: &PaperConfig,
        hyper: Hyper,
        draw: &InitialDraw,
    ) -> Result<Self, IndexError> {
        let model = InitialModel::new(hyper, &draw.means, &draw.alpha);
        let scoring = Scoring::new(&hyper);
        let is_padded = config.reassign == ReassignPolicy::Padded;
        let chooser = if is_padded {
            DestinationChooser::padded(config)
        } else {
            DestinationChooser::default()
        };
        Ok(Self {
            config: config.clone(),
            hyper,
            index: Index::new(&model, config.index)?,
            scoring,
            statistics: Statistics::new(model.len(), config.operations.update),
            passes: Passes::default(),
            q: Vec::new(),
            q_sums: Vec::new(),
            component_elbo: ComponentElbo::new(scoring),
            moves: Vec::new(),
            displaced: Vec::new(),
            places: Vec::new(),
            alpha_init: draw.alpha.clone(),
            chooser,
            model,
            frames: 0,
        })
    }

    /// Learns from one frame, whole or not at all: on an error before the fit the model is as it
    /// was; if only the forwarded reassignment after it fails, the frame is learnt and no component
    /// has moved.
    pub fn train(&mut self, points: &Points<R>) -> Result<FrameOutcome, IndexError> {
        let wall = Stopwatch::start();
        self.passes.begin_frame();
        let mut ms = StageMs::new(&PAPER_STAGES);
        let reassigned = match self.config.reassign {
            ReassignPolicy::Off => {
                self.fit(points, &mut ms);
                0
            }
            ReassignPolicy::Forwarded => {
                self.fit(points, &mut ms);
                // The unused of after the fit: what this frame has used must not move.
                self.reassign(points, self.quota(), &mut ms)?
            }
            ReassignPolicy::Dense | ReassignPolicy::Truncated | ReassignPolicy::Padded => {
                self.reassign_and_fit(points, &mut ms)?
            }
        };
        self.frames += 1;
        let (learnt, elbo_mean) = self.mean_elbo();
        ms.train = wall.elapsed_ms();
        Ok(FrameOutcome {
            points: learnt,
            evidence: learnt as u64,
            elbo_mean,
            reassigned,
            ms,
            ..FrameOutcome::default()
        })
    }

    /// Candidates of the pass that scores points before the fit.
    fn scored_by(&self) -> Candidates {
        match self.config.reassign {
            ReassignPolicy::Dense => Candidates::Dense,
            _ => self.config.candidates,
        }
    }

    fn fit(&mut self, points: &Points<R>, ms: &mut StageMs) {
        self.run_pass(points, self.config.candidates, Output::ElboAndSums, ms);
        self.commit(ms);
    }

    /// Moves components by the scores that points have before, and fits; how many moved. Where moves
    /// reach few tiles, the pass that scores is the fit already, and only those tiles are run again.
    fn reassign_and_fit(
        &mut self,
        points: &Points<R>,
        ms: &mut StageMs,
    ) -> Result<usize, IndexError> {
        let Some(quota) = self.quota() else {
            self.fit(points, ms);
            return Ok(0);
        };
        let is_fit = self.config.reassign != ReassignPolicy::Dense
            && quota.moves <= points.n_tiles()
            && self.passes.can_run_again(&self.inputs(self.config.candidates));
        let output = if is_fit { Output::ElboAndSums } else { Output::Elbo };
        self.run_pass(points, self.scored_by(), output, ms);
        let reassigned = self.reassign(points, Some(quota), ms)?;
        if is_fit {
            self.run_reached(points, ms);
            self.commit(ms);
        } else {
            self.fit(points, ms);
        }
        Ok(reassigned)
    }

    /// Runs the tiles again that the moves of this frame reach.
    fn run_reached(&mut self, points: &Points<R>, ms: &mut StageMs) {
        let mut clock = Stopwatch::start();
        let narrow = |space: [R; 3]| space.map(|v| v.to_f64() as f32);
        let left = self.displaced.iter().map(|&(space, _)| narrow(space));
        let came_to = self.moves.iter().map(|&(_, point)| narrow(points.position(point as usize)));
        self.places.clear();
        self.places.extend(left.chain(came_to));
        let inputs = PassInputs {
            model: &self.model,
            index: &self.index,
            scoring: &self.scoring,
            candidates: self.config.candidates,
            config: &self.config,
            statistics: &self.statistics,
        };
        let owners = self.component_elbo.owners();
        self.passes.run_reached(&inputs, points, &self.places, &mut self.q, owners);
        ms.add_pass(clock.lap_ms(), self.passes.processor.take_stage_nanos());
    }

    fn commit(&mut self, ms: &mut StageMs) {
        let mut clock = Stopwatch::start();
        self.passes.processor.commit(&mut self.statistics, self.config.operations.moments);
        self.component_elbo.count(&self.q, self.model.len());
        ms.add(PaperStage::Update as usize, clock.lap_ms());
    }

    fn run_pass(
        &mut self,
        points: &Points<R>,
        candidates: Candidates,
        output: Output,
        ms: &mut StageMs,
    ) {
        let mut clock = Stopwatch::start();
        let inputs = PassInputs {
            model: &self.model,
            index: &self.index,
            scoring: &self.scoring,
            candidates,
            config: &self.config,
            statistics: &self.statistics,
        };
        // Before the fit nobody owns a point: means are still to move.
        let owners = match output {
            Output::Elbo => None,
            Output::ElboAndSums => self.component_elbo.owners(),
        };
        self.passes.run(&inputs, points, output, &mut self.q, owners);
        ms.add_pass(clock.lap_ms(), self.passes.processor.take_stage_nanos());
    }

    /// Points that were learnt from and the mean of their ELBO; 0 without points.
    fn mean_elbo(&mut self) -> (usize, f64) {
        let Self { q, q_sums, scoring, .. } = self;
        q_sums.resize(q.len().div_ceil(SUMMED), (0.0, 0));
        let sums = q_sums.par_iter_mut().zip(q.par_chunks(SUMMED)).with_min_len(SUMS);
        sums.for_each(|(sums, q)| {
            *sums = q.iter().filter(|q| !q.is_nan()).fold((0.0, 0), |(sum, n), q| (sum + q, n + 1));
        });
        // In their order, for any number of threads.
        let (sum, n) = q_sums.iter().fold((0.0, 0), |all, part| (all.0 + part.0, all.1 + part.1));
        (n, if n == 0 { 0.0 } else { scoring.elbo(sum / n as f64) })
    }

    /// Before the first fit nothing is unused: the posterior is still the initial model, whose
    /// weights are not below the prior's (`train.md`, Reassignment).
    fn quota(&self) -> Option<Quota> {
        if self.frames == 0 && self.statistics.used() == 0 {
            return None;
        }
        Quota::new(&self.config, self.statistics.len() - self.statistics.used())
    }

    /// Moves components by the scores of the last pass; how many.
    fn reassign(
        &mut self,
        points: &Points<R>,
        quota: Option<Quota>,
        ms: &mut StageMs,
    ) -> Result<usize, IndexError> {
        let Some(quota) = quota else { return Ok(0) };
        let mut clock = Stopwatch::start();
        // Named by the frame, not carried along: a run that goes on draws as if it never stopped.
        let stream = Rng::new(self.config.seed, Purpose::Reassign, self.frames);
        let destinations = self.chooser.destinations(&self.q, quota, &stream);
        let mut moves = std::mem::take(&mut self.moves);
        moves.clear();
        // The lowest ids; the reference takes whichever an unstable sort of equals puts first.
        moves.extend(self.statistics.unused().zip(destinations.iter().copied()));
        let moved = self.move_components(points, &moves);
        let n = moves.len();
        self.moves = moves;
        ms.add(PaperStage::Reassign as usize, clock.lap_ms());
        moved.map(|()| n)
    }

    /// Sets the initial means of components to points, `(component, point)`, and renews the
    /// index. The components must be unused, or their statistics would lose their centre. On error
    /// nothing has moved.
    pub fn move_components(
        &mut self,
        points: &Points<R>,
        moves: &[(u32, u32)],
    ) -> Result<(), IndexError> {
        self.displaced.clear();
        if moves.is_empty() {
            return Ok(());
        }
        for &(component, point) in moves {
            let mean = (points.position(point as usize), points.color(point as usize));
            self.displaced.push(self.model.replace_mean(component as usize, mean));
        }
        let rebuilt = self.index.renew(&self.model, moves.iter().map(|&(component, _)| component));
        if rebuilt.is_err() {
            // Backwards, should a component move twice.
            for (&(component, _), &mean) in moves.iter().zip(&self.displaced).rev() {
                self.model.replace_mean(component as usize, mean);
            }
        } else if !self.passes.is_devices() {
            // Now, and not in the midst of the pass that wants it: it belongs to the reassignment.
            self.index.sorted(&self.model);
        }
        rebuilt
    }

    /// ELBO of every point of the last frame, in point order; NaN for points left out.
    pub fn elbo(&self) -> Vec<f64> {
        self.q.iter().map(|&q| self.scoring.elbo(q)).collect()
    }

    /// Effective distances of the points of the last frame (see [`Scoring::elbo`]).
    pub fn effective_distances(&self) -> &[f64] {
        &self.q
    }

    /// Scores of one point against given components, and the constants behind them.
    pub fn scoring(&self) -> (&Scoring, &InitialModel<R>) {
        (&self.scoring, &self.model)
    }

    /// Scores a frame's points without learning from them; the values are [`PaperTrainer::elbo`].
    pub fn evaluate(&mut self, points: &Points<R>, candidates: Candidates) {
        self.passes.begin_frame();
        self.run_pass(points, candidates, Output::Elbo, &mut StageMs::new(&PAPER_STAGES));
    }

    /// Runs passes on a device too from now on.
    ///
    /// # Errors
    /// [`DeviceError`] if it has no room for the means; then it is not used.
    pub fn compute_on(
        &mut self,
        device: Box<dyn MixtureDevice>,
        policy: DevicePolicy,
    ) -> Result<(), DeviceError> {
        self.passes.add_device(device, policy, &self.index, &self.model)
    }

    /// What passes ran on; `None` where the settings ask for what no device does.
    pub fn pass_use(&self) -> Option<PassUse> {
        self.passes.used(&self.inputs(self.config.candidates))
    }

    /// A model that goes on where another stopped after `frames` frames.
    pub fn restore(
        config: &PaperConfig,
        state: ModelState,
        frames: u64,
    ) -> Result<Self, IndexError> {
        let ModelState { alpha_init, means, totals } = state;
        // Means as reassignment left them: the index is not saved, but built of them anew.
        let draw = InitialDraw { means: means.rows(), alpha: alpha_init };
        let mut trainer = Self::new(config, &draw)?;
        trainer.statistics = Statistics::restore(&totals);
        trainer.frames = frames;
        Ok(trainer)
    }

    /// The model as it stands.
    pub fn state(&self) -> ModelState {
        ModelState {
            alpha_init: self.alpha_init.clone(),
            means: R::means(&self.model.space, &self.model.color),
            totals: self.statistics.state(),
        }
    }

    /// The settings.
    pub fn config(&self) -> &PaperConfig {
        &self.config
    }

    /// Evidence by component.
    pub fn component_elbo(&self) -> &ComponentElbo {
        &self.component_elbo
    }

    /// See [`Self::component_elbo`].
    pub fn component_elbo_mut(&mut self) -> &mut ComponentElbo {
        &mut self.component_elbo
    }

    /// Frames learnt.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Per point its candidates and their responsibilities, without learning from it.
    pub fn responsibilities(&self, points: &Points<R>) -> Vec<Vec<(u32, f64)>> {
        Pass::responsibilities(&self.inputs(self.config.candidates), points)
    }

    fn inputs(&self, candidates: Candidates) -> PassInputs<'_, R> {
        PassInputs {
            model: &self.model,
            index: &self.index,
            scoring: &self.scoring,
            candidates,
            config: &self.config,
            statistics: &self.statistics,
        }
    }

    /// Components, used or not.
    pub fn components(&self) -> usize {
        self.model.len()
    }

    /// Components with `N_k > 0`.
    pub fn used(&self) -> usize {
        self.statistics.used()
    }

    /// Totals over everything seen so far.
    pub fn statistics(&self) -> &Statistics {
        &self.statistics
    }

    /// Initial spatial mean of a component, normalised.
    pub fn mean_init(&self, component: usize) -> DVec3 {
        DVec3::from_array(self.model.space[component].map(R::to_f64))
    }

    /// Statistics of a component about its initial mean.
    pub fn moments(&self, component: usize) -> Moments {
        self.statistics.moments(component)
    }

    /// Posterior of a component, normalised coordinates.
    pub fn posterior(&self, component: usize) -> ComponentPosterior {
        ComponentPosterior::new(&self.hyper, self.mean_init(component), &self.moments(component))
    }

    /// Components whose statistics the last frame changed, each once.
    pub fn touched(&self) -> &[u32] {
        self.statistics.touched()
    }

    /// Bytes the model itself occupies: initial means and weights, and totals.
    pub fn model_bytes(&self) -> usize {
        let of_start = 7 * size_of::<R>() + size_of::<f64>();
        self.model.len() * (of_start + self.statistics.row_bytes())
    }
}
