//! Configurations of the paper's engine, timed in turns and rendered.

use super::oracle::Errors;
use super::runs;
use super::runs::{Runs, TimedConfiguration};
use super::sample::{TrainingSample, count};
use crate::bench::findings::{self, BenchError, Progress};
use crate::eval::metrics::Spread;
use crate::observation::points::Points;
use crate::train::paper::config::{Candidates, PaperConfig, Precision, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use crate::train::timing::{PaperStage, StageMs};
use serde::Serialize;

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
    let timed = runs::in_turns(&variants, repeats, &mut done)?;
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
