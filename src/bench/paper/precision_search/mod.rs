//! The cheapest precision of every operation that keeps the posterior within a bound of the f64
//! oracle: all combinations are timed in turns on sampled frames.

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

/// Searches all combinations.
pub fn run(
    plan: &SearchPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<PrecisionSearch, BenchError> {
    // One view will do: nothing is drawn here.
    let sample = TrainingSample::load(dataset, plan.frames, 1)?;
    let draw = settled_draw(plan, &sample)?;
    let all = combinations();
    let mut configs = Vec::with_capacity(all.len() + NAMED.len());
    for &operations in &all {
        let change = PaperOverrides { operations: Some(operations), ..PaperOverrides::default() };
        configs.push(plan.config(change)?);
    }
    // Beside all combinations: the points and means of `f64` are f64 too, as those of none of them.
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
    // The first of the named ones is f64 throughout.
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

/// Means as reassignment leaves them: every component near points.
fn settled_draw(plan: &SearchPlan, sample: &TrainingSample) -> Result<InitialDraw, BenchError> {
    let change = PaperOverrides {
        reassign: Some(ReassignPolicy::Forwarded),
        // Five times the preset's share: a dozen frames must be enough to settle the means.
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
