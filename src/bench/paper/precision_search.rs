//! Search for the fastest precision of each operation that keeps the posterior within an error
//! bound of the f64 oracle. All combinations are timed in turns on sampled frames.

use super::oracle::{PosteriorErrors, posterior_errors};
use super::runs;
use super::runs::{Runs, TimedConfiguration};
use super::sample::{TrainingSample, count};
use crate::bench::findings::{BENCH_FORMAT, BenchError, BenchOptions, Progress, steps};
use crate::dataset::Dataset;
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::math::measured_pixel::Normalization;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::train::paper::config::{
    Operations, PaperConfig, PaperOverrides, Precision, ReassignPolicy, UpdateWidth, Width,
};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::setting::ConfigError;
use crate::train::setting::table::SettingLayer;
use serde::Serialize;
use serde_json::json;
use std::sync::Arc;

#[derive(Clone, Debug)]
pub struct SearchPlan {
    pub components: usize,
    /// Maximum number of sampled frames.
    pub frames: usize,
    pub repeats: usize,
    /// Largest accepted error, as measured by [`PosteriorErrors::p99`].
    pub bound: f64,
    pub options: BenchOptions,
}

impl SearchPlan {
    /// Creates a plan with the paper's number of components, or a fifth of it if quick. Rejects a bound
    /// that is not above 0 and at most 1.
    pub fn new(options: BenchOptions, bound: f64) -> Result<Self, ConfigError> {
        if !(bound > 0.0 && bound <= 1.0) {
            return Err(ConfigError {
                setting: "bound (`--bound`)",
                expected: "a relative error above 0, at most 1, such as 1e-4".to_owned(),
                found: format!("{bound:?}"),
            });
        }
        // More runs than in other benches: the choice compares quartiles, which need several runs.
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

    /// Returns the settings shared by all combinations, with `change` applied. Reassignment is off, so
    /// that means are comparable between combinations.
    fn config(&self, change: PaperOverrides) -> Result<PaperConfig, ConfigError> {
        let base = PaperOverrides {
            components: Some(self.components),
            seed: Some(self.options.seed),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        // `or` keeps what `change` sets.
        PaperConfig::paper().with(&change.or(base))
    }
}

#[derive(Debug)]
pub struct PrecisionSearch {
    pub text: String,
    pub json: serde_json::Value,
    /// Settings file (RON) for `train --preset paper --config`.
    pub ron: String,
    pub operations: Operations,
}

/// Time and error of one combination of numeric precisions, one for each operation.
#[derive(Clone, Copy, Debug, Serialize)]
struct Combination {
    /// Name of this combination, or `custom` if it has none.
    precision: Precision,
    operations: Operations,
    /// Median time per frame, milliseconds.
    ms: f64,
    ms_quartiles: [f64; 2],
    error: PosteriorErrors,
    within_bound: bool,
}

impl Combination {
    fn new(config: &PaperConfig, runs: &Runs, truth: &[ComponentPosterior], bound: f64) -> Self {
        let Spread { median: ms, quartiles: ms_quartiles } = runs.spread(|ms| ms.train);
        let error = posterior_errors(&runs.engine.posteriors(), truth);
        let PaperConfig { precision, operations, .. } = *config;
        let within_bound = error.p99() <= bound;
        Self { precision, operations, ms, ms_quartiles, error, within_bound }
    }

    /// True if this combination is clearly faster: its third quartile is below the first quartile of
    /// `other`.
    fn is_faster_than(&self, other: &Self) -> bool {
        self.ms_quartiles[1] < other.ms_quartiles[0]
    }
}

/// Named precisions for comparison. The first is the oracle, which also stores points and means in f64.
const NAMED: [Precision; 2] = [Precision::F64, Precision::Mixed];

pub fn run(
    plan: &SearchPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<PrecisionSearch, BenchError> {
    // Nothing is rendered here, so one view is enough.
    let sample = TrainingSample::load(dataset, plan.frames, 1)?;
    // Few random means ever receive a point; the others would only measure the prior.
    let draw = settled_draw(plan, &sample)?;
    let all = combinations();
    let single = |operations| PaperOverrides { operations: Some(operations), ..Default::default() };
    let named = |precision| PaperOverrides { precision: Some(precision), ..Default::default() };
    let changes = all.iter().copied().map(single).chain(NAMED.map(named));
    let configs = changes.map(|change| plan.config(change)).collect::<Result<Vec<_>, _>>()?;
    let threads = rayon::current_num_threads();
    let variants: Vec<TimedConfiguration> = configs
        .into_iter()
        .map(|config| TimedConfiguration { config, threads, draw: &draw, frames: &sample.frames })
        .collect();
    let mut done = steps(progress, plan.repeats.max(1) * variants.len());
    let timed = runs::in_turns(&variants, plan.repeats, &mut done)?;
    // The oracle is the first named precision, which follows all combinations.
    let truth = timed[all.len()].engine.posteriors();
    let combination = |(v, runs): (&TimedConfiguration, &Runs)| {
        Combination::new(&v.config, runs, &truth, plan.bound)
    };
    let measured: Vec<Combination> = variants.iter().zip(&timed).map(combination).collect();
    let (combinations, named) = measured.split_at(all.len());
    into_search(plan, &sample, combinations, named)
}

/// Draws initial means near points. The means are those of a short training with reassignment of unused
/// components.
fn settled_draw(plan: &SearchPlan, sample: &TrainingSample) -> Result<InitialDraw, BenchError> {
    let change = PaperOverrides {
        reassign: Some(ReassignPolicy::Forwarded),
        // Five times the preset's share, so that a dozen frames suffice to settle the means.
        reassign_fraction: Some(0.25),
        ..PaperOverrides::default()
    };
    let config = plan.config(change)?;
    let draw = InitialDraw::random(plan.components, config.seed);
    let mut engine = learner::begin(&config, &draw, Normalization::IDENTITY)?;
    for frame in &sample.frames {
        engine.learn(frame)?;
    }
    let state = engine.state();
    Ok(InitialDraw { means: state.means.rows(), alpha: state.alpha_init })
}

/// Returns every assignment of floating-point precisions (f32 or f64) to the operations, highest
/// precision first.
fn combinations() -> Vec<Operations> {
    // A zero bit means f64, so that counting up goes from the widest to the narrowest.
    let width = |bits: u32, place: u32| match bits >> place & 1 {
        0 => Width::F64,
        _ => Width::F32,
    };
    let with = |bits| Operations {
        distance: width(bits, 4),
        log_score: width(bits, 3),
        normaliser: width(bits, 2),
        moments: width(bits, 1),
        update: if bits & 1 == 0 { UpdateWidth::Fixed128 } else { UpdateWidth::Fixed64 },
    };
    (0..1 << 5).map(with).collect()
}

/// Chooses a combination within the error bound, or returns `None` if there is none. Candidates are
/// those whose quartiles of time overlap those of the fastest. Of these, the one with the smallest
/// error is chosen; ties go to the highest precision.
fn choose(combinations: &[Combination]) -> Option<Combination> {
    let within = || combinations.iter().filter(|c| c.within_bound);
    let fastest = within().min_by(|a, b| a.ms.total_cmp(&b.ms))?;
    let alike = within().filter(|c| !fastest.is_faster_than(c));
    // `min_by` returns the first of equals, and the widest come first.
    alike.min_by(|a, b| a.error.p99().total_cmp(&b.error.p99())).copied()
}

fn into_search(
    plan: &SearchPlan,
    sample: &TrainingSample,
    combinations: &[Combination],
    named: &[Combination],
) -> Result<PrecisionSearch, BenchError> {
    let dataset = &sample.dataset.name;
    let chosen = choose(combinations).ok_or_else(|| BenchError::Bound {
        bound: plan.bound,
        best: combinations.iter().map(|c| c.error.p99()).fold(f64::INFINITY, f64::min),
    })?;
    let n_frames = sample.frames.len();
    let note = format!(
        "Bound {:e} on the relative errors of means and covariances against f64, 99 % quantile by evidence. {n_frames} frames of {} points, N = {}, C = 4, no reassignment, means settled by forwarded reassignment. {} combinations, {} runs in turns. `precision: f64` also has f64 points and means.",
        plan.bound,
        count(&sample.frames) / n_frames,
        plan.components,
        combinations.len(),
        plan.repeats
    );
    let machine = report::describe(None);
    let place = format!("{dataset}, {} threads, {}", machine.threads, machine.cpu);
    let text = [place, table(combinations, named, &chosen), note.clone()].join("\n\n");
    let json = json!({
        "format": BENCH_FORMAT,
        "bench": "precision-search",
        "dataset": dataset,
        "machine": machine,
        "options": plan.options,
        "bound": plan.bound,
        "notes": [note],
        "chosen": chosen,
        "combinations": combinations,
        "named": named,
    });
    let ron = settings(plan, dataset, &chosen)?;
    Ok(PrecisionSearch { text, json, ron, operations: chosen.operations })
}

/// Formats a table of the oracle, followed by all combinations from fast to slow.
fn table(combinations: &[Combination], named: &[Combination], chosen: &Combination) -> String {
    let cells = |c: &Combination| {
        let Operations { distance, log_score, normaliser, moments, update } = c.operations;
        // The oracle first: its operations equal those of the widest combination.
        let verdict = match (c.precision, c.within_bound) {
            (Precision::F64, _) => "oracle",
            _ if c.operations == chosen.operations => "chosen",
            (_, true) => "",
            (_, false) => "outside the bound",
        };
        [
            // Debug names, such as `F32`, are the shortest.
            format!("{distance:?}"),
            format!("{log_score:?}"),
            format!("{normaliser:?}"),
            format!("{moments:?}"),
            format!("{update:?}"),
            Spread { median: c.ms, quartiles: c.ms_quartiles }.to_string(),
            report::error(c.error.mean_p99),
            report::error(c.error.covariance_p99),
            verdict.to_owned(),
        ]
    };
    let mut rows = combinations.to_vec();
    rows.sort_by(|a, b| a.ms.total_cmp(&b.ms));
    let rows: Vec<_> = named.iter().take(1).chain(&rows).map(cells).collect();
    let header = [
        "distance",
        "log-score",
        "normaliser",
        "moments",
        "update",
        "ms/frame [quartiles]",
        "mean 99 %",
        "covariance 99 %",
        "",
    ];
    report::text(header, &rows)
}

/// Formats the chosen precisions as RON settings. Writes `mixed` if this named combination is equal,
/// otherwise the precision of every operation.
fn settings(plan: &SearchPlan, dataset: &str, chosen: &Combination) -> Result<String, BenchError> {
    let body = match chosen.operations {
        Operations::MIXED => format!("(precision: {})", ron::ser::to_string(&Precision::Mixed)?),
        operations => {
            let pretty = ron::ser::PrettyConfig::new();
            format!("(operations: {})", ron::ser::to_string_pretty(&operations, pretty)?)
        }
    };
    Ok(format!(
        "// Found by `precision-search {dataset} --bound {:e}`: {:.2} ms per frame, error {:.1e}.\n{body}\n",
        plan.bound,
        chosen.ms,
        chosen.error.p99()
    ))
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
    fn error_buys_measurable_time_only() {
        use UpdateWidth::{Fixed64, Fixed128};
        let chosen = |all: &[Combination]| choose(all).map(|c| c.operations.update);
        let slow = timed(Fixed128, 20.0, 0.0);
        assert_eq!(chosen(&[slow, timed(Fixed64, 10.0, 1e-6)]), Some(Fixed64));
        let alike = [timed(Fixed128, 10.5, 1e-6), timed(Fixed64, 10.0, 1e-5)];
        assert_eq!(chosen(&alike), Some(Fixed128), "half a millisecond is within the spread");
        let equal = [timed(Fixed128, 10.5, 1e-6), timed(Fixed64, 10.0, 1e-6)];
        assert_eq!(chosen(&equal), Some(Fixed128), "the widest of equals");
        assert_eq!(chosen(&[slow, timed(Fixed64, 10.0, 1e-3)]), Some(Fixed128), "the bound holds");
        assert_eq!(chosen(&[timed(Fixed64, 10.0, 1e-3)]), None);
    }

    #[test]
    fn combinations_are_unique_and_begin_with_the_widest() {
        let all = combinations();
        assert_eq!((all.len(), all[0], all[31]), (32, Operations::F64, Operations::MIXED));
        assert!((0..32).all(|i| !all[..i].contains(&all[i])));
    }
}
