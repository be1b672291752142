//! The trainer of one precision: owns the model and applies frames to it.

use super::candidates::{IndexError, Scalar};
use super::config::{Candidates, ReassignPolicy, TrainConfig};
use super::estep::Scoring;
use super::init::InitialDraw;
use super::pass::{Inputs, Output, Pass};
use super::reassign::{self, Quota};
use super::timing::{StageMs, Stopwatch};
use crate::math::points::Points;
use crate::math::rng::{Purpose, Rng};
use crate::model::mixture::InitialModel;
use crate::model::posterior::ComponentPosterior;
use crate::model::prior::Hyper;
use crate::model::state::ModelState;
use crate::model::statistics::{Moments, Statistics};
use glam::DVec3;
use std::num::NonZero;

/// What one frame did to the model.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct FrameOutcome {
    /// Points learnt from.
    pub points: usize,
    /// Mean of the points' ELBO under the initial model; 0 without points.
    pub elbo_mean: f64,
    /// Components that moved.
    pub reassigned: usize,
    /// Where the time went.
    pub ms: StageMs,
}

/// Model and buffers in precision `R`.
pub struct Trainer<R: Scalar> {
    config: TrainConfig,
    hyper: Hyper,
    model: InitialModel<R>,
    index: R::Index,
    scoring: Scoring<R>,
    statistics: Statistics,
    pass: Pass<R>,
    elbo: Vec<f64>,
    touched: Touched,
    /// Where the components of a reassignment came from, should it fail.
    displaced: Vec<[R; 3]>,
    alpha_init: Vec<f64>,
    frames: u64,
}

/// Ids written by the current frame, each once.
#[derive(Default)]
struct Touched {
    ids: Vec<u32>,
    stamps: Vec<u32>,
    stamp: u32,
}

impl<R: Scalar> Trainer<R> {
    /// A model that has seen nothing. `draw` holds one mean and one weight per component.
    pub fn new(config: &TrainConfig, draw: &InitialDraw) -> Result<Self, IndexError> {
        Self::with_hyper(config, config.hyper(), draw)
    }

    /// The same with hyper-parameters of one's own instead of the preset's.
    pub fn with_hyper(
        config: &TrainConfig,
        hyper: Hyper,
        draw: &InitialDraw,
    ) -> Result<Self, IndexError> {
        let model = InitialModel::new(hyper, &draw.means, &draw.alpha);
        Ok(Self {
            config: config.clone(),
            hyper,
            index: R::build(&model.space)?,
            scoring: Scoring::new(&hyper),
            statistics: Statistics::new(model.len()),
            pass: Pass::default(),
            elbo: Vec::new(),
            touched: Touched { stamps: vec![0; model.len()], ..Touched::default() },
            displaced: Vec::new(),
            alpha_init: draw.alpha.clone(),
            model,
            frames: 0,
        })
    }

    /// Learns from one frame, whole or not at all: on an error before the fit the model is as it
    /// was; if only the forwarded reassignment after it fails, the frame is learnt and no component
    /// has moved.
    pub fn train(&mut self, points: &Points<R>) -> Result<FrameOutcome, IndexError> {
        let wall = Stopwatch::start();
        let mut ms = StageMs::default();
        let before = matches!(
            self.config.reassign,
            ReassignPolicy::Dense | ReassignPolicy::Truncated | ReassignPolicy::Padded
        );
        let mut reassigned = 0;
        if before && let Some(quota) = self.quota() {
            let candidates = match self.config.reassign {
                ReassignPolicy::Dense => Candidates::Dense,
                _ => self.config.candidates,
            };
            self.run_pass(points, candidates, Output::Elbo, &mut ms);
            reassigned = self.reassign(points, quota, &mut ms)?;
        }
        self.fit(points, &mut ms);
        if self.config.reassign == ReassignPolicy::Forwarded
            && let Some(quota) = self.quota()
        {
            reassigned = self.reassign(points, quota, &mut ms)?;
        }
        self.frames += 1;
        ms.train = wall.elapsed_ms();
        let elbo_mean = self.elbo.iter().sum::<f64>() / points.len().max(1) as f64;
        Ok(FrameOutcome { points: points.len(), elbo_mean, reassigned, ms })
    }

    fn fit(&mut self, points: &Points<R>, ms: &mut StageMs) {
        self.run_pass(points, self.config.candidates, Output::ElboAndSums, ms);
        let mut clock = Stopwatch::start();
        self.touched.begin();
        for record in self.pass.records() {
            self.statistics.add(record);
            self.touched.mark(record.id);
        }
        ms.update += clock.lap_ms();
    }

    fn run_pass(
        &mut self,
        points: &Points<R>,
        candidates: Candidates,
        output: Output,
        ms: &mut StageMs,
    ) {
        let mut clock = Stopwatch::start();
        let inputs =
            Inputs { model: &self.model, index: &self.index, scoring: self.scoring, candidates };
        self.pass.run(&inputs, points, output);
        self.pass.elbo_into(&mut self.elbo);
        ms.add_pass(clock.lap_ms(), self.pass.thread_nanos());
    }

    /// Before the first fit nothing is unused: the posterior is still the initial model, whose
    /// weights are not below the prior's (`model.md` 10).
    fn quota(&self) -> Option<Quota> {
        if self.frames == 0 && self.statistics.used() == 0 {
            return None;
        }
        let unused = self.statistics.len() - self.statistics.used();
        let TrainConfig { reassign, reassign_fraction, low_elbo_floor, .. } = self.config;
        Quota::new(reassign, self.model.len(), unused, reassign_fraction, low_elbo_floor)
    }

    fn reassign(
        &mut self,
        points: &Points<R>,
        quota: Quota,
        ms: &mut StageMs,
    ) -> Result<usize, IndexError> {
        let mut clock = Stopwatch::start();
        let mut rng = Rng::new(self.config.seed, Purpose::Reassign, self.frames);
        let destinations = reassign::destinations(&self.elbo, quota, || rng.uniform());
        let unused = (0..self.statistics.len()).filter(|&k| !self.statistics.is_used(k));
        let moves: Vec<(u32, u32)> = unused.map(|k| k as u32).zip(destinations).collect();
        self.move_components(points, &moves)?;
        ms.reassign += clock.lap_ms();
        Ok(moves.len())
    }

    /// Sets the initial means of components to points, `(component, point)`, and rebuilds the
    /// index. The components must be unused, or their statistics would lose their centre. On error
    /// nothing has moved.
    pub fn move_components(
        &mut self,
        points: &Points<R>,
        moves: &[(u32, u32)],
    ) -> Result<(), IndexError> {
        let InitialModel { space, color, .. } = &mut self.model;
        self.displaced.clear();
        for &(component, point) in moves {
            let mean = &mut space[component as usize];
            self.displaced.push(std::mem::replace(mean, points.position(point as usize)));
        }
        if let Err(error) = R::rebuild(&mut self.index, space) {
            // Backwards, should a component move twice.
            for (&(component, _), &mean) in moves.iter().zip(&self.displaced).rev() {
                space[component as usize] = mean;
            }
            return Err(error);
        }
        for &(component, point) in moves {
            color[component as usize] = points.color(point as usize);
        }
        Ok(())
    }

    /// ELBO of every point of the last frame, in point order.
    pub fn elbo(&self) -> &[f64] {
        &self.elbo
    }

    /// Candidate ids of a point in ascending distance.
    pub fn nearest(&self, position: [R; 3], n: NonZero<usize>) -> Vec<u32> {
        let mut ids = Vec::new();
        R::nearest(&self.index, &position, n, &mut ids);
        ids
    }

    /// Scores of one point against given components, and the constants behind them.
    pub fn scoring(&self) -> (&Scoring<R>, &InitialModel<R>) {
        (&self.scoring, &self.model)
    }

    /// Scores a frame's points without learning from them; the values are [`Trainer::elbo`].
    pub fn evaluate(&mut self, points: &Points<R>, candidates: Candidates) {
        self.run_pass(points, candidates, Output::Elbo, &mut StageMs::default());
    }

    /// A model that goes on where another stopped after `frames` frames.
    pub fn restore(
        config: &TrainConfig,
        state: ModelState,
        frames: u64,
    ) -> Result<Self, IndexError> {
        let ModelState { alpha_init, means, totals } = state;
        let draw = InitialDraw { means: means.rows(), alpha: alpha_init };
        let mut trainer = Self::new(config, &draw)?;
        trainer.statistics = Statistics::restore(totals);
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

    /// Frames learnt.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Per point its candidates and their responsibilities, without learning from it.
    pub fn responsibilities(&mut self, points: &Points<R>) -> Vec<Vec<(u32, f64)>> {
        let inputs = Inputs {
            model: &self.model,
            index: &self.index,
            scoring: self.scoring,
            candidates: self.config.candidates,
        };
        Pass::responsibilities(&inputs, points)
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
        &self.touched.ids
    }

    /// Bytes the model itself occupies: initial means and weights, and totals.
    pub fn model_bytes(&self) -> usize {
        self.model.len()
            * (7 * size_of::<R>() + size_of::<[i128; crate::model::statistics::N_SUMS]>())
    }
}

impl Touched {
    fn begin(&mut self) {
        self.ids.clear();
        if self.stamp == u32::MAX {
            self.stamps.fill(0);
            self.stamp = 0;
        }
        self.stamp += 1;
    }

    fn mark(&mut self, id: u32) {
        let stamp = &mut self.stamps[id as usize];
        if *stamp != self.stamp {
            *stamp = self.stamp;
            self.ids.push(id);
        }
    }
}
