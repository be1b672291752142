//! Trainer of one precision: owns the model and applies frames to it.
//!
//! Frames are scored against the initial model, never the posterior (`model.md`, Three models), so the
//! sums of frames are additive. Only building the index can fail, and this happens before or after a
//! frame is added. So a frame is applied completely or not at all.

use super::config::{Candidates, PaperConfig, ReassignPolicy};
use super::index::{Index, PaperScalar};
use super::init::InitialDraw;
use super::pass::{Mixture, Output, Pass, PassInputs};
use super::passes::Passes;
use super::reassign::{DestinationChooser, Quota};
use crate::math::rng::{Purpose, Rng};
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::model::conjugate::prior::Hyper;
use crate::model::conjugate::statistics::Moments;
use crate::model::paper::state::{InitialModel, ModelState};
use crate::model::paper::totals::Statistics;
use crate::observation::points::Points;
use crate::train::candidates::IndexError;
use crate::train::component_elbo::ComponentElbo;
use crate::train::estep::Scoring;
use crate::train::outcome::FrameOutcome;
use crate::train::timing::{PAPER_STAGES, PaperStage, StageMs, Stopwatch};
use glam::DVec3;
use rayon::prelude::*;

// Points per partial sum; fixed, so that the mean does not depend on the number of threads.
const SUMMED: usize = 64;
const SUMS: usize = 128;

/// Model of the `paper` preset with its training buffers, in precision `R`.
pub struct PaperTrainer<R: PaperScalar> {
    pub(super) mixture: Mixture<R>,
    alpha_init: Vec<f64>,
    pub(super) passes: Passes,
    /// Effective distance of each point of the last frame.
    q: Vec<f64>,
    q_sums: Vec<(f64, usize)>,
    pub(super) component_elbo: ComponentElbo,
    chooser: DestinationChooser,
    /// Components moved by the last reassignment, each with the index of the point to which it moved.
    moves: Vec<(u32, u32)>,
    /// Means that the components in `moves` had before the move, to undo a failed reassignment.
    displaced: Vec<([R; 3], [R; 3])>,
    places: Vec<[f32; 3]>,
    /// Number of frames trained on.
    pub(super) frames: u64,
}

impl<R: PaperScalar> PaperTrainer<R> {
    /// Creates an untrained model. `draw` holds one mean and one Dirichlet parameter per component.
    pub fn new(config: &PaperConfig, draw: &InitialDraw) -> Result<Self, IndexError> {
        Self::with_hyper(config, config.hyper(), draw)
    }

    /// Creates an untrained model with custom hyper-parameters.
    pub fn with_hyper(
        config: &PaperConfig,
        hyper: Hyper,
        draw: &InitialDraw,
    ) -> Result<Self, IndexError> {
        let model = InitialModel::new(hyper, &draw.means, &draw.alpha);
        let scoring = Scoring::new(&hyper);
        Ok(Self {
            mixture: Mixture {
                config: config.clone(),
                index: Index::new(&model)?,
                scoring,
                statistics: Statistics::new(model.len(), config.operations.update),
                model,
            },
            alpha_init: draw.alpha.clone(),
            passes: Passes::default(),
            q: Vec::new(),
            q_sums: Vec::new(),
            component_elbo: ComponentElbo::new(scoring),
            chooser: match config.reassign {
                ReassignPolicy::Padded => DestinationChooser::reserved(config),
                _ => DestinationChooser::default(),
            },
            moves: Vec::new(),
            displaced: Vec::new(),
            places: Vec::new(),
            frames: 0,
        })
    }

    /// Trains on one frame, completely or not at all. On an error before the fit, the model is
    /// unchanged. If only the forwarded reassignment after the fit fails, the frame is applied and no
    /// component moves.
    pub fn train(&mut self, points: &Points<R>) -> Result<FrameOutcome, IndexError> {
        let wall = Stopwatch::start();
        self.passes.begin_frame();
        let mut ms = StageMs::new(&PAPER_STAGES);
        let reassigned = match self.mixture.config.reassign {
            ReassignPolicy::Off => {
                self.fit(points, &mut ms);
                0
            }
            ReassignPolicy::Forwarded => {
                self.fit(points, &mut ms);
                // Counted after the fit: components used by this frame must not move.
                self.reassign(points, self.quota(), &mut ms)?
            }
            ReassignPolicy::Dense | ReassignPolicy::Padded => {
                self.reassign_and_fit(points, &mut ms)?
            }
        };
        // Only here, after all that can fail.
        self.frames += 1;
        let (n_points, elbo_mean) = self.mean_elbo();
        ms.train = wall.elapsed_ms();
        Ok(FrameOutcome {
            points: n_points,
            evidence: n_points as u64,
            elbo_mean,
            reassigned,
            ms,
            ..FrameOutcome::default()
        })
    }

    fn fit(&mut self, points: &Points<R>, ms: &mut StageMs) {
        self.run_pass(points, self.mixture.config.candidates, Output::ElboAndSums, ms);
        self.commit(ms);
    }

    /// Scores the components, moves those that the scores select, then fits; returns the number of
    /// components moved. If the moves affect only a few tiles, the results of the scoring pass are
    /// reused for the fit. Then only the affected tiles are run again.
    fn reassign_and_fit(
        &mut self,
        points: &Points<R>,
        ms: &mut StageMs,
    ) -> Result<usize, IndexError> {
        let Some(quota) = self.quota() else {
            self.fit(points, ms);
            return Ok(0);
        };
        // Dense scoring uses other candidates than the fit. With more moves than tiles, few tiles
        // would remain unaffected.
        let (candidates, is_fit) = match self.mixture.config.reassign {
            ReassignPolicy::Dense => (Candidates::Dense, false),
            _ => {
                let can_run_again = self.passes.can_run_again(&self.inputs());
                let is_fit = quota.moves <= points.n_tiles() && can_run_again;
                (self.mixture.config.candidates, is_fit)
            }
        };
        let output = if is_fit { Output::ElboAndSums } else { Output::Elbo };
        self.run_pass(points, candidates, output, ms);
        let reassigned = self.reassign(points, Some(quota), ms)?;
        if is_fit {
            self.run_reached(points, ms);
            self.commit(ms);
        } else {
            self.fit(points, ms);
        }
        Ok(reassigned)
    }

    fn run_reached(&mut self, points: &Points<R>, ms: &mut StageMs) {
        let mut clock = Stopwatch::start();
        let narrow = |space: [R; 3]| space.map(|v| v.to_f64() as f32);
        // A move changes scores at both of its ends.
        let left = self.displaced.iter().map(|&(space, _)| narrow(space));
        let came_to = self.moves.iter().map(|&(_, point)| narrow(points.position(point as usize)));
        self.places.clear();
        self.places.extend(left.chain(came_to));
        let candidates = self.mixture.config.candidates;
        let inputs = PassInputs { mixture: &self.mixture, candidates };
        let owners = self.component_elbo.owners();
        self.passes.run_reached(&inputs, points, &self.places, &mut self.q, owners);
        ms.add_pass(clock.lap_ms(), self.passes.processor.take_stage_nanos());
    }

    fn commit(&mut self, ms: &mut StageMs) {
        let mut clock = Stopwatch::start();
        let Mixture { config, model, statistics, .. } = &mut self.mixture;
        self.passes.processor.commit(statistics, config.operations.moments);
        self.component_elbo.accumulate(&self.q, model.len());
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
        let inputs = PassInputs { mixture: &self.mixture, candidates };
        // Owners are not recorded before the fit, since means are still to move.
        let owners = match output {
            Output::Elbo => None,
            Output::ElboAndSums => self.component_elbo.owners(),
        };
        self.passes.run(&inputs, points, output, &mut self.q, owners);
        ms.add_pass(clock.lap_ms(), self.passes.processor.take_stage_nanos());
    }

    fn mean_elbo(&mut self) -> (usize, f64) {
        let Self { q, q_sums, mixture, .. } = self;
        q_sums.resize(q.len().div_ceil(SUMMED), (0.0, 0));
        let sums = q_sums.par_iter_mut().zip(q.par_chunks(SUMMED)).with_min_len(SUMS);
        sums.for_each(|(sums, q)| {
            // NaN marks points left out.
            *sums = q.iter().filter(|q| !q.is_nan()).fold((0.0, 0), |(sum, n), q| (sum + q, n + 1));
        });
        // Summed in order, so that the result does not depend on the number of threads.
        let (sum, n) = q_sums.iter().fold((0.0, 0), |all, part| (all.0 + part.0, all.1 + part.1));
        (n, if n == 0 { 0.0 } else { mixture.scoring.elbo(sum / n as f64) })
    }

    /// Returns the quota of the next reassignment, if any. Before the first fit, every component counts
    /// as used: the posterior then equals the initial model, whose weights are not below the prior's
    /// (`training.md`, Reassignment).
    fn quota(&self) -> Option<Quota> {
        let Mixture { config, statistics, .. } = &self.mixture;
        if self.frames == 0 && statistics.used() == 0 {
            return None;
        }
        Quota::new(config, statistics.len() - statistics.used())
    }

    /// Moves components, selected by the scores of the last pass; returns the number of components
    /// moved.
    fn reassign(
        &mut self,
        points: &Points<R>,
        quota: Option<Quota>,
        ms: &mut StageMs,
    ) -> Result<usize, IndexError> {
        let Some(quota) = quota else { return Ok(0) };
        let mut clock = Stopwatch::start();
        // Derived from the frame number, so that a resumed run draws the same numbers.
        let stream = Rng::new(self.mixture.config.seed, Purpose::Reassign, self.frames);
        let destinations = self.chooser.choose_destinations(&self.q, quota, &stream);
        // Taken out of `self`, which `move_components` borrows mutably.
        let mut moves = std::mem::take(&mut self.moves);
        moves.clear();
        // The lowest ids; the reference uses the order of an unstable sort of equals.
        moves.extend(self.mixture.statistics.unused().zip(destinations.iter().copied()));
        let moved = self.move_components(points, &moves);
        let n = moves.len();
        self.moves = moves;
        ms.add(PaperStage::Reassign as usize, clock.lap_ms());
        moved.map(|()| n)
    }

    /// Moves initial means of components to points, given as `(component, point)`, and updates the index.
    ///
    /// The components must be unused, because statistics are relative to the means. On error, no
    /// component moves.
    pub fn move_components(
        &mut self,
        points: &Points<R>,
        moves: &[(u32, u32)],
    ) -> Result<(), IndexError> {
        self.displaced.clear();
        if moves.is_empty() {
            return Ok(());
        }
        let Mixture { model, index, .. } = &mut self.mixture;
        for &(component, point) in moves {
            let mean = (points.position(point as usize), points.color(point as usize));
            self.displaced.push(model.replace_mean(component as usize, mean));
        }
        let rebuilt = index.update_moved(model, moves.iter().map(|&(component, _)| component));
        if rebuilt.is_err() {
            // In reverse, in case a component moves twice.
            for (&(component, _), &mean) in moves.iter().zip(&self.displaced).rev() {
                model.replace_mean(component as usize, mean);
            }
        } else if !self.passes.is_next_on_device() {
            // Sorted here, so that its time counts as reassignment and not as part of the next pass.
            index.sorted(model);
        }
        rebuilt
    }

    /// Returns the ELBO of each point of the last frame, nats, in point order; NaN for points left out.
    pub fn elbo(&self) -> Vec<f64> {
        self.q.iter().map(|&q| self.mixture.scoring.elbo(q)).collect()
    }

    /// Returns the effective distances of the points of the last frame (see [`Scoring::elbo`]).
    pub fn effective_distances(&self) -> &[f64] {
        &self.q
    }

    /// Returns the constants of the log-score, and the model that scores points.
    pub fn scoring(&self) -> (&Scoring, &InitialModel<R>) {
        (&self.mixture.scoring, &self.mixture.model)
    }

    /// Scores a frame's points without training on the frame; [`PaperTrainer::elbo`] returns the
    /// results.
    pub fn evaluate(&mut self, points: &Points<R>, candidates: Candidates) {
        self.passes.begin_frame();
        self.run_pass(points, candidates, Output::Elbo, &mut StageMs::new(&PAPER_STAGES));
    }

    /// Restores a model as it was after `frames` frames.
    pub fn restore(
        config: &PaperConfig,
        state: ModelState,
        frames: u64,
    ) -> Result<Self, IndexError> {
        let ModelState { alpha_init, means, totals } = state;
        // Includes the means moved by reassignment. The index is not saved but rebuilt.
        let draw = InitialDraw { means: means.rows(), alpha: alpha_init };
        let mut trainer = Self::new(config, &draw)?;
        trainer.mixture.statistics = Statistics::restore(&totals);
        trainer.frames = frames;
        Ok(trainer)
    }

    /// Returns the model's state for a checkpoint.
    pub fn state(&self) -> ModelState {
        ModelState {
            alpha_init: self.alpha_init.clone(),
            means: R::means(&self.mixture.model.space, &self.mixture.model.color),
            totals: self.mixture.statistics.state(),
        }
    }

    /// Computes the candidates of each point with their responsibilities, without training.
    pub fn responsibilities(&self, points: &Points<R>) -> Vec<Vec<(u32, f64)>> {
        Pass::responsibilities(&self.inputs(), points)
    }

    pub(super) fn inputs(&self) -> PassInputs<'_, R> {
        PassInputs { mixture: &self.mixture, candidates: self.mixture.config.candidates }
    }

    /// Number of components, used or not.
    pub fn components(&self) -> usize {
        self.mixture.model.len()
    }

    /// Number of components with `N_k > 0`.
    pub fn used(&self) -> usize {
        self.mixture.statistics.used()
    }

    /// Returns the initial spatial mean of a component, normalised.
    pub fn mean_init(&self, component: usize) -> DVec3 {
        DVec3::from_array(self.mixture.model.space[component].map(R::to_f64))
    }

    /// Returns the statistics of a component, about its initial mean.
    pub fn moments(&self, component: usize) -> Moments {
        self.mixture.statistics.moments(component)
    }

    /// Posterior of a component, in normalised coordinates.
    pub fn posterior(&self, component: usize) -> ComponentPosterior {
        let (mean, moments) = (self.mean_init(component), self.moments(component));
        ComponentPosterior::new(&self.mixture.model.hyper, mean, &moments)
    }
}
