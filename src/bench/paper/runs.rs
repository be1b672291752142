//! Configurations of the paper's engine, timed in turns (A B C A B C), so that other load on the machine slows all of
//! them alike, and rendered.

use super::oracle::Errors;
use super::sample::{TrainingSample, count};
use crate::bench::findings::{self, BenchError, Progress};
use crate::eval::metrics::Spread;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::train::paper::config::{Candidates, PaperConfig, Precision, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::paper::learner::PaperLearner;
use crate::train::timing::{PAPER_STAGES, PaperStage, StageMs};
use rayon::ThreadPoolBuilder;
use serde::Serialize;

pub struct TimedConfiguration<'a> {
    pub config: PaperConfig,
    pub threads: usize,
    pub draw: &'a InitialDraw,
    pub frames: &'a [Points<f32>],
}

pub struct Runs {
    /// Time per frame of each run: the median of each stage over the frames.
    pub runs: Vec<StageMs>,
    /// Model after the last run.
    pub engine: Box<dyn PaperLearner>,
}

impl Runs {
    pub fn spread(&self, of: impl Fn(&StageMs) -> f64) -> Spread {
        Spread::of(self.runs.iter().map(of).collect())
    }

    /// Returns the median of each stage over the runs in milliseconds, in the order of [`PAPER_STAGES`].
    pub fn stages(&self) -> [f64; PAPER_STAGES.len()] {
        std::array::from_fn(|i| self.spread(|ms| ms.values()[i]).median)
    }
}

/// Trains each variant from its initial draw on all its frames, `repeats` times, taking turns with the
/// other variants. The first frame of a run warms up buffers and is excluded unless it is the only one.
/// Calls `done` after every run.
pub fn in_turns(
    variants: &[TimedConfiguration],
    repeats: usize,
    done: &mut dyn FnMut(),
) -> Result<Vec<Runs>, BenchError> {
    let mut found: Vec<Option<Runs>> = variants.iter().map(|_| None).collect();
    for _ in 0..repeats.max(1) {
        for (variant, slot) in variants.iter().zip(&mut found) {
            // Drop the model of the previous turn first, so that each variant has at most one in
            // memory.
            let mut runs = slot.take().map_or_else(Vec::new, |earlier| earlier.runs);
            let (engine, ms) = with_threads(variant.threads, || run(variant))??;
            runs.push(ms);
            *slot = Some(Runs { runs, engine });
            done();
        }
    }
    Ok(found.into_iter().flatten().collect())
}

/// Runs `work` on a new pool of `threads` threads.
pub fn with_threads<T: Send>(
    threads: usize,
    work: impl FnOnce() -> T + Send,
) -> Result<T, BenchError> {
    // The number of threads of the global pool cannot change between turns.
    let pool = ThreadPoolBuilder::new().num_threads(threads).build();
    Ok(pool.map_err(|e| BenchError::Threads { threads, reason: e.to_string() })?.install(work))
}

fn run(variant: &TimedConfiguration) -> Result<(Box<dyn PaperLearner>, StageMs), BenchError> {
    let TimedConfiguration { config, draw, frames, .. } = variant;
    let mut engine = learner::begin(config, draw, Normalization::IDENTITY)?;
    let mut times = Vec::with_capacity(frames.len());
    for frame in *frames {
        times.push(engine.learn(frame)?.ms);
    }
    // A single frame counts although it is cold: otherwise there would be no time.
    let counted = &times[usize::from(times.len() > 1)..];
    Ok((engine, StageMs::combine(counted, |values| Spread::of(values).median)))
}

pub struct TimedStep {
    /// Name of the varied setting.
    pub sweep: &'static str,
    pub name: String,
    pub config: PaperConfig,
    pub threads: usize,
    pub draw: InitialDraw,
    /// True to train on thinned frames, because all points would take too long.
    pub is_thinned: bool,
}

/// One row of a table. Times are medians over the runs, in milliseconds per frame with all its points.
#[derive(Clone, Debug, Serialize)]
pub struct TimedRow {
    pub sweep: &'static str,
    pub configuration: String,
    pub components: usize,
    pub candidates: Candidates,
    pub precision: Precision,
    pub reassign: ReassignPolicy,
    pub threads: usize,
    /// Fraction of the points that were processed. Times that grow with the number of points are scaled
    /// up to all points.
    pub points_share: f64,
    pub ms: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    pub candidates_ms: f64,
    pub e_step_ms: f64,
    pub stats_ms: f64,
    pub update_ms: f64,
    pub reassign_ms: f64,
    /// Mean PSNR of the held-out views in dB, of the model trained on the processed points.
    pub psnr: f64,
    /// Number of components with statistics after the last frame.
    pub used: usize,
    // Differences from the dense f64 oracle, where it was run: nats, total variation of responsibilities,
    // relative errors of the posterior with 99 % quantiles by evidence.
    pub elbo_diff_max: Option<f64>,
    pub elbo_diff_mean: Option<f64>,
    pub total_variation_mean: Option<f64>,
    pub total_variation_max: Option<f64>,
    pub mean_error_p99: Option<f64>,
    pub mean_error_max: Option<f64>,
    pub covariance_error_p99: Option<f64>,
    pub covariance_error_max: Option<f64>,
}

/// Times all steps in turns. Passes each step and its runs to `errors` and returns one row per step.
/// `progress` counts runs and rows.
pub fn time(
    steps: &[TimedStep],
    sample: &TrainingSample,
    thinned: &[Points<f32>],
    repeats: usize,
    progress: Progress,
    errors: impl Fn(&TimedStep, &Runs) -> Result<Option<Errors>, BenchError>,
) -> Result<Vec<TimedRow>, BenchError> {
    let frames = |step: &TimedStep| if step.is_thinned { thinned } else { &sample.frames[..] };
    let variants: Vec<TimedConfiguration> = steps
        .iter()
        .map(|step| TimedConfiguration {
            config: step.config.clone(),
            threads: step.threads,
            draw: &step.draw,
            frames: frames(step),
        })
        .collect();
    let mut done = findings::steps(progress, (repeats.max(1) + 1) * steps.len());
    let timed = in_turns(&variants, repeats, &mut done)?;
    let mut rows = Vec::with_capacity(steps.len());
    for (step, runs) in steps.iter().zip(&timed) {
        // Counted, because whole tiles only approximate the requested number of points.
        let share = count(frames(step)) as f64 / count(&sample.frames) as f64;
        rows.push(TimedRow::new(step, runs, sample, share, errors(step, runs)?)?);
        done();
    }
    Ok(rows)
}

impl TimedRow {
    fn new(
        step: &TimedStep,
        runs: &Runs,
        sample: &TrainingSample,
        points_share: f64,
        errors: Option<Errors>,
    ) -> Result<Self, BenchError> {
        // Update and reassignment visit components, so they do not grow with the number of points.
        let scaled = |ms: &StageMs| {
            let stage = |stage: PaperStage| ms.values()[stage as usize];
            let per_component = stage(PaperStage::Update) + stage(PaperStage::Reassign);
            (ms.train - per_component) / points_share + per_component
        };
        let ms = runs.spread(scaled);
        let [candidates, e_step, stats, update_ms, reassign_ms] = runs.stages();
        let config = &step.config;
        Ok(Self {
            sweep: step.sweep,
            configuration: step.name.clone(),
            components: config.components,
            candidates: config.candidates,
            precision: config.precision,
            reassign: config.reassign,
            threads: step.threads,
            points_share,
            ms: ms.median,
            ms_q1: ms.quartiles[0],
            ms_q3: ms.quartiles[1],
            // These three stages grow with the number of points, the next two do not.
            candidates_ms: candidates / points_share,
            e_step_ms: e_step / points_share,
            stats_ms: stats / points_share,
            update_ms,
            reassign_ms,
            psnr: sample.psnr(&*runs.engine, config)?,
            used: runs.engine.status().used,
            elbo_diff_max: errors.map(|e| e.elbo_max),
            elbo_diff_mean: errors.map(|e| e.elbo_mean),
            total_variation_mean: errors.map(|e| e.variation_mean),
            total_variation_max: errors.map(|e| e.variation_max),
            mean_error_p99: errors.map(|e| e.posterior.mean_p99),
            mean_error_max: errors.map(|e| e.posterior.mean_max),
            covariance_error_p99: errors.map(|e| e.posterior.covariance_p99),
            covariance_error_max: errors.map(|e| e.posterior.covariance_max),
        })
    }

    pub fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}
