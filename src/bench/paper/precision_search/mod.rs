//! Search for the fastest precision of each operation that keeps the posterior within an error
//! bound of the f64 oracle. All combinations are timed in turns on sampled frames.

mod report;

use super::runs;
use super::runs::TimedConfiguration;
use super::sample::TrainingSample;
use crate::bench::findings::{BenchError, Progress};
use crate::dataset::Dataset;
use crate::math::measured_pixel::Normalization;
use crate::train::paper::config::{PaperOverrides, Precision, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use report::{combinations, posteriors};
use std::sync::Arc;

pub use report::{OperationRow, PrecisionCombination, PrecisionSearch, SearchPlan, Verdict};

pub fn run(
    plan: &SearchPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<PrecisionSearch, BenchError> {
    // Nothing is rendered here, so one view is enough.
    let sample = TrainingSample::load(dataset, plan.frames, 1)?;
    let draw = settled_draw(plan, &sample)?;
    let all = combinations();
    let mut configs = Vec::with_capacity(all.len() + NAMED.len());
    for &operations in &all {
        let change = PaperOverrides { operations: Some(operations), ..PaperOverrides::default() };
        configs.push(plan.config(change)?);
    }
    // Named precisions in addition: only `f64` also stores points and means in f64.
    for precision in NAMED {
        let change = PaperOverrides { precision: Some(precision), ..PaperOverrides::default() };
        configs.push(plan.config(change)?);
    }
    let threads = rayon::current_num_threads();
    let variants: Vec<TimedConfiguration> = configs
        .into_iter()
        .map(|config| TimedConfiguration { config, threads, draw: &draw, frames: &sample.frames })
        .collect();
    let (mut done, steps) = (0, plan.repeats.max(1) * variants.len());
    let timed = runs::in_turns(&variants, plan.repeats, &mut || {
        done += 1;
        progress(done, steps);
    })?;
    // The first named precision is f64 throughout.
    let truth = posteriors(&*timed[all.len()].engine);
    let measured: Vec<PrecisionCombination> = variants
        .iter()
        .zip(&timed)
        .map(|(variant, runs)| PrecisionCombination::new(&variant.config, runs, &truth, plan.bound))
        .collect();
    let (combinations, named) = measured.split_at(all.len());
    report::report(plan, &sample, combinations, named)
}

/// Named precisions for comparison; the first is the oracle.
const NAMED: [Precision; 3] = [Precision::F64, Precision::Mixed, Precision::F32];

/// Draws means as reassignment leaves them: each component is near points.
fn settled_draw(plan: &SearchPlan, sample: &TrainingSample) -> Result<InitialDraw, BenchError> {
    let change = PaperOverrides {
        reassign: Some(ReassignPolicy::Forwarded),
        // Five times the preset's share, so that a dozen frames suffice to settle the means.
        reassign_fraction: Some(0.25),
        ..PaperOverrides::default()
    };
    let config = plan.config(change)?;
    let mut engine = learner::begin(
        &config,
        &InitialDraw::random(plan.components, config.seed),
        Normalization::IDENTITY,
    )?;
    for frame in &sample.frames {
        engine.learn(frame)?;
    }
    let state = engine.state();
    Ok(InitialDraw { means: state.means.rows(), alpha: state.alpha_init })
}
