//! The cheapest precision of every operation that keeps the posterior within a bound of the f64
//! oracle: all combinations are timed in turns on sampled frames.

mod forms;

pub use forms::{OperationRow, Verdict};

use super::bench::oracle::{PosteriorErrors, posterior_errors};
use super::bench::runs::{self, Runs, Variant};
use super::bench::sample::Sample;
use super::bench::spread::Spread;
use super::bench::{BenchError, BenchOptions, Progress};
use crate::dataset::Dataset;
use crate::model::posterior::ComponentPosterior;
use crate::train::config::{
    ConfigError, Operations, Overrides, Precision, ReassignPolicy, TrainConfig, UpdateWidth, Width,
};
use crate::train::engine::Engine;
use crate::train::init::InitialDraw;
use serde::Serialize;
use std::sync::Arc;

/// What is searched, and how thoroughly.
#[derive(Clone, Debug)]
pub struct SearchPlan {
    /// Components.
    pub components: usize,
    /// Sampled frames at most.
    pub frames: usize,
    /// Runs of every combination.
    pub repeats: usize,
    /// Largest [`PosteriorErrors::p99`] that is accepted.
    pub bound: f64,
    /// What was asked for.
    pub options: BenchOptions,
}

impl SearchPlan {
    /// At the paper's N, or a fifth of it. The bound must be positive.
    pub fn new(options: BenchOptions, bound: f64) -> Result<Self, ConfigError> {
        if !(bound.is_finite() && bound > 0.0) {
            return Err(ConfigError {
                setting: "bound",
                expected: "a positive relative error, such as 1e-4".to_owned(),
                found: bound.to_string(),
            });
        }
        let (components, frames, repeats) =
            if options.quick { (20_000, 6, 9) } else { (100_000, 12, 15) };
        Ok(Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            repeats: options.repeats.unwrap_or(repeats),
            bound,
            options,
        })
    }

    fn config(&self, change: Overrides) -> Result<TrainConfig, ConfigError> {
        let base = Overrides {
            components: Some(self.components),
            seed: Some(self.options.seed),
            reassign: Some(ReassignPolicy::Off),
            ..Overrides::default()
        };
        TrainConfig::paper().with(&change.or(base))
    }
}

/// One combination of widths.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Combination {
    /// Name of the precision; `custom` for all but the named ones.
    pub precision: Precision,
    /// Widths.
    pub operations: Operations,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First and third quartile over the runs.
    pub ms_quartiles: [f64; 2],
    /// Distance to the oracle.
    pub error: PosteriorErrors,
    /// Whether the distance is within the bound.
    pub within_bound: bool,
}

impl Combination {
    /// Whether three quarters of the runs are faster than three quarters of another's.
    fn is_faster_than(&self, other: &Self) -> bool {
        self.ms_quartiles[1] < other.ms_quartiles[0]
    }

    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: self.ms_quartiles }
    }
}

/// The result, ready to be printed and written.
pub struct Search {
    /// For people.
    pub text: String,
    /// For machines.
    pub json: serde_json::Value,
    /// Settings that `train --preset paper --config` takes.
    pub ron: String,
    /// The widths chosen.
    pub operations: Operations,
}

/// Searches all combinations.
pub fn run(
    plan: &SearchPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Search, BenchError> {
    let sample = Sample::load(dataset, plan.frames, 1)?;
    let draw = settled_draw(plan, &sample)?;
    let all = combinations();
    let mut configs = Vec::with_capacity(all.len() + NAMED.len());
    for &operations in &all {
        let change = Overrides { operations: Some(operations), ..Overrides::default() };
        configs.push(plan.config(change)?);
    }
    for precision in NAMED {
        let change = Overrides { precision: Some(precision), ..Overrides::default() };
        configs.push(plan.config(change)?);
    }
    let threads = rayon::current_num_threads();
    let variants: Vec<Variant> = configs
        .into_iter()
        .map(|config| Variant { config, threads, draw: &draw, frames: &sample.frames })
        .collect();
    let (mut done, steps) = (0, plan.repeats.max(1) * variants.len());
    let timed = runs::in_turns(&variants, plan.repeats, &mut || {
        done += 1;
        progress(done, steps);
    })?;
    // The first of the named ones is f64 throughout.
    let truth = posteriors(&timed[all.len()].engine);
    let measured: Vec<Combination> = variants
        .iter()
        .zip(&timed)
        .map(|(variant, runs)| combination(&variant.config, runs, &truth, plan.bound))
        .collect();
    let (combinations, named) = measured.split_at(all.len());
    forms::report(plan, &sample, combinations, named)
}

/// Named precisions for comparison; the first is the oracle.
const NAMED: [Precision; 3] = [Precision::F64, Precision::Mixed, Precision::F32];

/// Means as reassignment leaves them: every component near points.
fn settled_draw(plan: &SearchPlan, sample: &Sample) -> Result<InitialDraw, BenchError> {
    let change = Overrides {
        reassign: Some(ReassignPolicy::Forwarded),
        reassign_fraction: Some(0.25),
        ..Overrides::default()
    };
    let config = plan.config(change)?;
    let mut engine = Engine::new(&config, &InitialDraw::random(plan.components, config.seed))?;
    for frame in &sample.frames {
        engine.train(frame)?;
    }
    let state = engine.state();
    Ok(InitialDraw { means: state.means.rows(), alpha: state.alpha_init })
}

const WIDTHS: [Width; 2] = [Width::F64, Width::F32];
const UPDATES: [UpdateWidth; 3] = [UpdateWidth::Fixed128, UpdateWidth::Fixed64, UpdateWidth::F32];

fn combinations() -> Vec<Operations> {
    let mut all = Vec::new();
    for distance in WIDTHS {
        for log_score in WIDTHS {
            for normaliser in WIDTHS {
                for moments in WIDTHS {
                    let with =
                        |update| Operations { distance, log_score, normaliser, moments, update };
                    all.extend(UPDATES.map(with));
                }
            }
        }
    }
    all
}

fn posteriors(engine: &Engine) -> Vec<ComponentPosterior> {
    (0..engine.components()).map(|k| engine.posterior(k)).collect()
}

fn combination(
    config: &TrainConfig,
    runs: &Runs,
    truth: &[ComponentPosterior],
    bound: f64,
) -> Combination {
    let ms = runs.spread(|ms| ms.train);
    let error = posterior_errors(&posteriors(&runs.engine), truth);
    Combination {
        precision: config.precision,
        operations: config.operations,
        ms: ms.median,
        ms_quartiles: ms.quartiles,
        error,
        within_bound: error.p99() <= bound,
    }
}

/// Of all combinations within the bound that cannot be told from the fastest one, the spreads of
/// their runs overlapping, that of least error; the widest of equals. `None` if none keeps the
/// bound.
fn choose(combinations: &[Combination]) -> Option<Combination> {
    let within = || combinations.iter().filter(|c| c.within_bound);
    let fastest = within().min_by(|a, b| a.ms.total_cmp(&b.ms))?;
    let alike = within().filter(|c| !fastest.is_faster_than(c));
    alike.min_by(|a, b| a.error.p99().total_cmp(&b.error.p99())).copied()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn timed(update: UpdateWidth, ms: f64, error: f64) -> Combination {
        Combination {
            precision: Precision::Custom,
            operations: Operations { update, ..Operations::F64 },
            ms,
            ms_quartiles: [ms - 1.0, ms + 1.0],
            error: PosteriorErrors { covariance_p99: error, ..PosteriorErrors::default() },
            within_bound: error <= 1e-4,
        }
    }

    #[test]
    fn what_is_no_faster_is_not_bought_with_error() {
        use UpdateWidth::{F32, Fixed64, Fixed128};
        let chosen = |all: &[Combination]| choose(all).map(|c| c.operations.update);
        let slow = timed(Fixed128, 20.0, 0.0);
        assert_eq!(chosen(&[slow, timed(Fixed64, 10.0, 1e-6)]), Some(Fixed64));
        let alike = [timed(Fixed64, 10.5, 1e-6), timed(F32, 10.0, 1e-5)];
        assert_eq!(chosen(&alike), Some(Fixed64), "half a millisecond is within the spread");
        let equal = [timed(Fixed128, 10.5, 1e-6), timed(F32, 10.0, 1e-6)];
        assert_eq!(chosen(&equal), Some(Fixed128), "the widest of equals");
        assert_eq!(chosen(&[slow, timed(F32, 10.0, 1e-3)]), Some(Fixed128), "the bound holds");
        assert_eq!(chosen(&[timed(F32, 10.0, 1e-3)]), None);
    }
}
