//! A training session: a dataset, a configuration and a model that grows frame by frame.

use super::births::Births;
use super::learner::{Learner, PaperLearner};
use super::machine;
use super::memory::{Estimate, MemoryError};
use super::plan::{Order, Plan, Selection};
use super::prefetch::{Prefetch, Prepared, PreparedFrame, SpawnError};
use super::run::{RunConfig, initial_draw};
use super::settings::method::{Asked, Method};
use super::settings::scene::{SceneError, SceneRun};
use crate::dataset::error::DatasetError;
use crate::dataset::range::{self, RangeError};
use crate::dataset::{Dataset, Layout};
use crate::eval::report::{
    DatasetReport, EvalReport, FrameMs, FrameReport, REPORT_FORMAT, Report, SkippedFrame, Summary,
};
use crate::math::normalization::Normalization;
use crate::math::orbit::mean_up;
use crate::model::splat::appearance::SplatSet;
use crate::train::candidates::IndexError;
use crate::train::paper::engine::Engine;
use crate::train::scene::engine::SceneEngine;
use glam::DVec3;
use std::sync::Arc;
use std::time::Instant;

/// Why a session cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The dataset does not hold what was asked for.
    #[error(transparent)]
    Dataset(#[from] DatasetError),
    /// The scene preset does not suit the dataset.
    #[error(transparent)]
    Scene(#[from] SceneError),
    /// The range of positions could not be found.
    #[error(transparent)]
    Range(#[from] RangeError),
    /// The decoding thread did not start.
    #[error(transparent)]
    Spawn(#[from] SpawnError),
    /// The machine has not enough memory.
    #[error(transparent)]
    Memory(#[from] MemoryError),
    /// The candidate index could not be built.
    #[error(transparent)]
    Index(#[from] IndexError),
    /// Settings or reports could not be written as JSON.
    #[error("writing the run's settings as JSON failed: {0}; report this as a defect")]
    Json(#[from] serde_json::Error),
    /// Every frame was skipped.
    #[error(
        "{dataset}: expected at least one usable frame, found none ({skipped} skipped; the first: {first})"
    )]
    NoUsableFrame {
        /// Name of the dataset.
        dataset: String,
        /// Frames skipped.
        skipped: usize,
        /// Message of the first one.
        first: String,
    },
}

/// What one step did.
#[derive(Clone, Debug)]
pub enum Step {
    /// A frame was learnt.
    Trained(FrameReport),
    /// A frame was unusable and left out.
    Skipped(SkippedFrame),
    /// There are no more frames.
    Finished,
}

/// What a run has behind it when a session begins.
pub(super) struct Past {
    /// Positions of the plan gone through.
    pub visited: usize,
    /// Points learnt.
    pub points: u64,
    /// Reports of the frames learnt, as far as they are known.
    pub frames: Vec<FrameReport>,
    /// Frames that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Seconds spent.
    pub wall_s: f64,
}

/// A dataset, a configuration and a model that grows frame by frame.
pub struct Session {
    dataset: Arc<Dataset>,
    config: RunConfig,
    plan: Plan,
    normalization: Normalization,
    learner: Learner,
    births: Births,
    prefetch: Prefetch,
    /// Everything up to the last step.
    past: Past,
    started: Instant,
    /// Seconds spent before `started`.
    wall_before_s: f64,
}

impl Session {
    /// Prepares a session and starts decoding. Frames the dataset refused when it was opened count
    /// as skipped.
    pub fn new(
        dataset: Arc<Dataset>,
        asked: impl Into<Asked>,
        selection: Selection,
    ) -> Result<Self, SessionError> {
        let asked = asked.into();
        let seed = asked.seed();
        let plan = Plan::new(&dataset, &selection, seed)?;
        // A scene says best what is wrong with its depth.
        let method = match asked {
            Asked::Paper(config) => Method::Paper(config),
            Asked::Scene(overrides) => {
                // Frames in their own order: whatever is found in them is the same in any order.
                let whole = Selection { order: Order::Sequential, ..selection.whole() };
                let all = Plan::new(&dataset, &whole, seed)?;
                Method::Scene(Box::new(SceneRun::new(&dataset, &all, &overrides)?))
            }
        };
        let range = range::estimate(&dataset, plan.split)?;
        let config = RunConfig::new(&dataset, method, selection, &range);
        let (learner, normalization) = match &config.method {
            Method::Paper(train) => {
                let normalization = range.normalization();
                let threads = rayon::current_num_threads();
                Estimate::new(train, plan.pixels(&dataset), threads).check(train.components)?;
                let draw = initial_draw(&dataset, &config, train, normalization)?;
                let engine = Engine::new(train, &draw)?;
                let paper = PaperLearner { engine, config: train.clone(), normalization };
                (Learner::Paper(Box::new(paper)), normalization)
            }
            Method::Scene(run) => {
                let engine = SceneEngine::new(&run.engine, run.surface.origin);
                (Learner::Scene(engine), run.normalization())
            }
        };
        let past = Past::none(&dataset, plan.split);
        Self::begin(dataset, config, plan, normalization, learner, past)
    }

    /// Starts decoding behind what the run has behind it.
    pub(super) fn begin(
        dataset: Arc<Dataset>,
        config: RunConfig,
        plan: Plan,
        normalization: Normalization,
        learner: Learner,
        past: Past,
    ) -> Result<Self, SessionError> {
        let preparation = config.preparation(normalization);
        let prefetch = Prefetch::start(dataset.clone(), &plan, past.visited, preparation)?;
        let (started, wall_before_s) = (Instant::now(), past.wall_s);
        let session = Self {
            dataset,
            config,
            plan,
            normalization,
            births: Births::new(&learner),
            learner,
            prefetch,
            past,
            started,
            wall_before_s,
        };
        Ok(session)
    }

    /// Trains on the next frame, waiting for it to be decoded. On errors see [`crate::train::paper::engine::Engine::train`].
    pub fn step(&mut self) -> Result<Step, SessionError> {
        let Some(Prepared { position, name, result }) = self.prefetch.next_frame() else {
            return self.finish();
        };
        // Whatever becomes of it, no run that goes on from here may learn this frame again.
        self.past.visited = position + 1;
        let step = match result {
            Ok(prepared) => Step::Trained(self.learn(position, name, prepared)?),
            Err(message) => {
                let skipped = SkippedFrame { frame: name, message };
                self.past.skipped.push(skipped.clone());
                Step::Skipped(skipped)
            }
        };
        self.past.wall_s = self.wall_before_s + self.started.elapsed().as_secs_f64();
        Ok(step)
    }

    fn finish(&self) -> Result<Step, SessionError> {
        if self.learner.frames() > 0 {
            return Ok(Step::Finished);
        }
        Err(SessionError::NoUsableFrame {
            dataset: self.dataset.name.clone(),
            skipped: self.past.skipped.len(),
            first: self
                .past
                .skipped
                .first()
                .map_or_else(|| "no frame is selected".into(), |s| s.message.clone()),
        })
    }

    fn learn(
        &mut self,
        position: usize,
        frame: String,
        prepared: PreparedFrame,
    ) -> Result<FrameReport, SessionError> {
        let PreparedFrame { material, counts, load_ms, prepare_ms } = prepared;
        let outcome = self.learner.train(&material)?;
        self.prefetch.recycle(material);
        self.births.record(self.learner.touched(), position);
        let report = FrameReport {
            index: position,
            frame,
            points: outcome.points,
            points_dropped: counts.dropped(),
            components: self.learner.components(),
            used: self.learner.used(),
            reassigned: outcome.reassigned,
            elbo_mean: outcome.elbo_mean,
            ms: FrameMs { load: load_ms, prepare: prepare_ms, stages: outcome.ms },
        };
        self.past.points += outcome.points as u64;
        self.past.frames.push(report.clone());
        Ok(report)
    }

    /// The dataset.
    pub fn dataset(&self) -> &Arc<Dataset> {
        &self.dataset
    }

    /// Frames of the run.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Settings of the run.
    pub fn config(&self) -> &RunConfig {
        &self.config
    }

    /// The model.
    pub fn learner(&self) -> &Learner {
        &self.learner
    }

    /// Sums the ELBO of the frames to come by component, for [`Self::attributes_of`].
    pub fn start_component_elbo(&mut self) {
        self.learner.start_component_elbo();
    }

    /// Ends what [`Self::start_component_elbo`] began.
    pub fn stop_component_elbo(&mut self) {
        self.learner.stop_component_elbo();
    }

    /// Position in the run of the frame in which a component first received points, if that was in
    /// this session.
    pub(super) fn birth_of(&self, component: usize) -> Option<u32> {
        self.births.of(component)
    }

    /// Points learnt.
    pub fn points(&self) -> u64 {
        self.past.points
    }

    /// World to model coordinates.
    pub fn normalization(&self) -> &Normalization {
        &self.normalization
    }

    /// What lies behind the next step.
    pub(super) fn past(&self) -> &Past {
        &self.past
    }

    /// What the run takes of the machine's memory at most.
    pub fn memory(&self) -> Estimate {
        let pixels = self.plan.pixels(&self.dataset);
        match &self.config.method {
            Method::Paper(train) => Estimate::new(train, pixels, rayon::current_num_threads()),
            Method::Scene(run) => Estimate::of_scene(&run.engine, pixels),
        }
    }

    /// Positions of the plan gone through, by learning a frame or by skipping it.
    pub fn visited(&self) -> usize {
        self.past.visited
    }

    /// Direction that points up in the world, as far as the cameras tell.
    pub fn up(&self) -> DVec3 {
        mean_up(self.dataset.splits[self.plan.split].frames.iter().map(|f| &f.camera.pose))
    }

    /// Trained frames so far, in order.
    pub fn frames(&self) -> &[FrameReport] {
        &self.past.frames
    }

    /// Unusable frames so far.
    pub fn skipped(&self) -> &[SkippedFrame] {
        &self.past.skipped
    }

    /// Splats of all components, world units; slot `k` is component `k`, opacity 0 if not drawn.
    pub fn splats(&self) -> SplatSet {
        self.learner.splats()
    }

    /// The same in the order in which checkpoints hold the components: what files are made of, so
    /// that equal models give equal files.
    pub fn stored_splats(&self) -> SplatSet {
        self.learner.stored_splats()
    }

    /// Splats of the listed components.
    pub fn splats_of(&self, ids: &[u32]) -> SplatSet {
        self.learner.splats_of(ids)
    }

    /// Components that are drawn.
    fn drawn(&self) -> usize {
        self.splats().view().splats().iter().filter(|splat| splat.opacity > 0.0).count()
    }

    /// The report so far; `adapter` names the graphics adapter that draws, if any.
    pub fn report(&self, adapter: Option<String>, eval: Vec<EvalReport>) -> Report<RunConfig> {
        let split = &self.dataset.splits[self.plan.split];
        let first = self.plan.frames.first().map(|&i| split.frames[i].camera.intrinsics);
        Report {
            format: REPORT_FORMAT,
            dataset: DatasetReport {
                path: self
                    .dataset
                    .path
                    .as_ref()
                    .map_or_else(|| self.dataset.name.clone(), |p| p.display().to_string()),
                layout: layout_name(self.dataset.layout).to_owned(),
                split: split.name.clone(),
                frames: self.plan.frames.len(),
                width: first.map_or(0, |k| k.width),
                height: first.map_or(0, |k| k.height),
            },
            config: self.config.clone(),
            machine: machine::describe(adapter),
            frames: self.past.frames.clone(),
            skipped: self.past.skipped.clone(),
            summary: Summary {
                components: self.learner.components(),
                used: self.learner.used(),
                drawn: self.drawn(),
                model_bytes: self.learner.model_bytes(),
                peak_rss_bytes: machine::peak_rss_bytes(),
                ..Summary::of_frames(&self.past.frames, self.past.wall_s)
            },
            eval,
            seen: Vec::new(),
        }
    }
}

/// As reports and `info` spell it.
pub fn layout_name(layout: Layout) -> &'static str {
    layout.name()
}

impl Past {
    /// Nothing but the frames that the dataset refused when it was opened.
    pub fn none(dataset: &Dataset, split: usize) -> Self {
        let name = &dataset.splits[split].name;
        let refused = dataset.warnings.iter().filter(|w| w.split == *name);
        Self {
            visited: 0,
            points: 0,
            frames: Vec::new(),
            skipped: refused.map(|w| SkippedFrame::from(&*w.error)).collect(),
            wall_s: 0.0,
        }
    }
}
