//! Evaluation of the timed combinations: tables, JSON, and settings for
//! `train --preset paper --config`.
//!
//! Each width is judged twice: by its error while all other widths are f64, and by its time in the
//! fastest combination that uses it.

use crate::bench::findings::{BENCH_FORMAT, BenchError, BenchOptions};
use crate::bench::paper::oracle::{PosteriorErrors, posterior_errors};
use crate::bench::paper::runs::Runs;
use crate::bench::paper::sample::{TrainingSample, count};
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::eval::report::MachineReport;
use crate::model::conjugate::posterior::ComponentPosterior;
use crate::train::paper::config::{
    Operations, PaperConfig, PaperOverrides, Precision, ReassignPolicy, UpdateWidth, Width,
};
use crate::train::paper::learner::PaperLearner;
use crate::train::setting::ConfigError;
use crate::train::setting::table::SettingLayer;
use serde::Serialize;

/// Result of the search, ready to print and write.
#[derive(Debug)]
pub struct PrecisionSearch {
    /// Tables and notes, as printed.
    pub text: String,
    pub json: serde_json::Value,
    /// Settings for `train --preset paper --config`.
    pub ron: String,
    pub operations: Operations,
}

/// Error and speed of one width of one operation.
#[derive(Clone, Debug, Serialize)]
pub struct OperationRow {
    pub operation: &'static str,
    pub width: &'static str,
    /// Error while all other operations have their widest width.
    pub error_alone: f64,
    /// Median milliseconds per frame of the fastest combination within the bound that uses this
    /// width. `None` if there is none.
    pub best_ms: Option<f64>,
    pub verdict: Verdict,
}

/// Outcome of the search for one width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// In the result, and measurably faster than the widest width.
    Chosen,
    /// In the result, but not faster than the widest width within the spread of the runs.
    ChosenGainsNothing,
    /// Not in the result, and not faster than the widest width within the spread of the runs.
    GainsNothing,
    /// Faster than the widest width, but another width was chosen.
    NotChosen,
    /// No combination that uses it keeps the bound.
    OutsideBound,
}

impl Verdict {
    fn sentence(self) -> &'static str {
        match self {
            Self::Chosen => "chosen",
            Self::ChosenGainsNothing => "chosen; no measurable gain",
            Self::GainsNothing => "no measurable gain",
            Self::NotChosen => "not chosen",
            Self::OutsideBound => "outside the bound",
        }
    }
}

#[derive(Serialize)]
struct SearchReport<'a> {
    format: &'static str,
    bench: &'static str,
    dataset: &'a str,
    machine: MachineReport,
    options: BenchOptions,
    bound: f64,
    notes: &'a [String],
    rows: &'a [OperationRow],
    chosen: PrecisionCombination,
    combinations: &'a [PrecisionCombination],
    named: &'a [PrecisionCombination],
}

/// Returns the name of an operation's width.
type WidthOf = fn(&Operations) -> &'static str;

fn width_name(width: Width) -> &'static str {
    match width {
        Width::F32 => "f32",
        Width::F64 => "f64",
    }
}

fn update_name(width: UpdateWidth) -> &'static str {
    match width {
        UpdateWidth::F32 => "f32",
        UpdateWidth::Fixed64 => "fixed64",
        UpdateWidth::Fixed128 => "fixed128",
    }
}

/// Operations, accessors of their widths, and possible widths from wide to narrow.
const OPERATIONS: [(&str, WidthOf, &[&str]); 5] = [
    ("distance", |o| width_name(o.distance), &["f64", "f32"]),
    ("log-score", |o| width_name(o.log_score), &["f64", "f32"]),
    ("normaliser", |o| width_name(o.normaliser), &["f64", "f32"]),
    ("moments", |o| width_name(o.moments), &["f64", "f32"]),
    ("update", |o| update_name(o.update), &["fixed128", "fixed64", "f32"]),
];

fn operation_rows(combinations: &[PrecisionCombination], chosen: &Operations) -> Vec<OperationRow> {
    let mut rows = Vec::new();
    for (operation, width_of, widths) in OPERATIONS {
        let best = |width: &str| {
            let having = combinations.iter().filter(|c| c.within_bound);
            let having = having.filter(|c| width_of(&c.operations) == width);
            having.min_by(|a, b| a.ms.total_cmp(&b.ms))
        };
        let widest = best(widths[0]);
        for &width in widths {
            let found = best(width);
            let is_faster = found.zip(widest).is_some_and(|(f, w)| f.is_faster_than(w));
            let is_chosen = width_of(chosen) == width;
            // The widest width has no wider one to compare with, so it never counts as without
            // gain.
            let verdict = match (found, is_chosen, is_faster || width == widths[0]) {
                (None, _, _) => Verdict::OutsideBound,
                (_, true, true) => Verdict::Chosen,
                (_, true, false) => Verdict::ChosenGainsNothing,
                (_, false, true) => Verdict::NotChosen,
                (_, false, false) => Verdict::GainsNothing,
            };
            let error_alone =
                alone(combinations, operation, width).map_or(f64::NAN, |c| c.error.p99());
            let best_ms = found.map(|c| c.ms);
            rows.push(OperationRow { operation, width, error_alone, best_ms, verdict });
        }
    }
    rows
}

/// Finds the combination in which all other operations have their widest width.
fn alone<'a>(
    combinations: &'a [PrecisionCombination],
    operation: &str,
    width: &str,
) -> Option<&'a PrecisionCombination> {
    combinations.iter().find(|c| {
        OPERATIONS.iter().all(|(name, width_of, widths)| {
            width_of(&c.operations) == if *name == operation { width } else { widths[0] }
        })
    })
}

/// Builds all outputs.
pub fn report(
    plan: &SearchPlan,
    sample: &TrainingSample,
    combinations: &[PrecisionCombination],
    named: &[PrecisionCombination],
) -> Result<PrecisionSearch, BenchError> {
    let dataset = &sample.dataset.name;
    let chosen = choose(combinations).ok_or_else(|| BenchError::Bound {
        bound: plan.bound,
        best: combinations.iter().map(|c| c.error.p99()).fold(f64::INFINITY, f64::min),
    })?;
    let rows = operation_rows(combinations, &chosen.operations);
    let notes = notes(plan, sample, combinations, &named[0], &chosen);
    let machine = report::describe(None);
    let place = format!("{dataset}, {} threads, {}", machine.threads, machine.cpu);
    let tables = [operations_table(&rows), summary_table(named, &chosen)];
    let text = [place].into_iter().chain(tables).chain(notes.iter().cloned());
    let text = text.collect::<Vec<_>>().join("\n\n");
    let report = SearchReport {
        format: BENCH_FORMAT,
        bench: "precision-search",
        dataset,
        machine,
        options: plan.options,
        bound: plan.bound,
        notes: &notes,
        rows: &rows,
        chosen,
        combinations,
        named,
    };
    let json = serde_json::to_value(&report)?;
    Ok(PrecisionSearch {
        text,
        json,
        ron: settings(plan, dataset, &chosen)?,
        operations: chosen.operations,
    })
}

fn operations_table(rows: &[OperationRow]) -> String {
    let cells = |row: &OperationRow| {
        [
            row.operation.to_owned(),
            row.width.to_owned(),
            report::error(row.error_alone),
            row.best_ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}")),
            row.verdict.sentence().to_owned(),
        ]
    };
    let header = ["operation", "width", "error alone", "best ms/frame with it", "verdict"];
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn summary_table(named: &[PrecisionCombination], chosen: &PrecisionCombination) -> String {
    let names = ["f64 (oracle)", "mixed", "f32", "chosen"];
    let cells = |(name, c): (&str, &PrecisionCombination)| {
        [
            name.to_owned(),
            c.spread().to_string(),
            report::error(c.error.mean_p99),
            report::error(c.error.mean_max),
            report::error(c.error.covariance_p99),
            report::error(c.error.covariance_max),
        ]
    };
    let rows = names.into_iter().zip(named.iter().chain([chosen])).map(cells);
    let header = [
        "precision",
        "ms/frame [quartiles]",
        "mean 99 %",
        "mean max",
        "covariance 99 %",
        "covariance max",
    ];
    report::text(header, &rows.collect::<Vec<_>>())
}

fn notes(
    plan: &SearchPlan,
    sample: &TrainingSample,
    combinations: &[PrecisionCombination],
    oracle: &PrecisionCombination,
    chosen: &PrecisionCombination,
) -> Vec<String> {
    let n_frames = sample.frames.len();
    let widest = combinations.iter().find(|c| c.operations == Operations::F64);
    let gain = widest.map_or(1.0, |widest| widest.ms / chosen.ms);
    let measurable = widest.is_some_and(|w| chosen.is_faster_than(w));
    let result = if measurable {
        format!("The chosen widths are {gain:.2} times as fast as f64 on the same f32 points.")
    } else {
        "No width is measurably faster than f64 on the same f32 points.".to_owned()
    };
    let mut notes = vec![
        format!(
            "Bound {:e} on the relative errors of means and covariances against f64, 99 % quantile by evidence. {n_frames} frames of {} points, N = {}, C = 4, no reassignment, means settled by forwarded reassignment. {} combinations, {} runs in turns.",
            plan.bound,
            count(&sample.frames) / n_frames,
            plan.components,
            combinations.len(),
            plan.repeats
        ),
        result,
        format!(
            "`--precision f64`, which also has f64 points, means and index, takes {:.2} times as long.",
            oracle.ms / chosen.ms
        ),
    ];
    if chosen.operations.update == UpdateWidth::F32 {
        notes.push("f32 totals depend on the order of frames and drift over long runs.".to_owned());
    }
    notes
}

/// Formats the chosen widths as RON: a named precision if one has these widths, otherwise all
/// operations. `f64` never matches, because its points and means are f64 as well.
fn settings(
    plan: &SearchPlan,
    dataset: &str,
    chosen: &PrecisionCombination,
) -> Result<String, BenchError> {
    let named = match chosen.operations {
        Operations::MIXED => Some(Precision::Mixed),
        Operations::F32 => Some(Precision::F32),
        _ => None,
    };
    let pretty = ron::ser::PrettyConfig::new();
    let body = match named {
        Some(precision) => format!("(precision: {})", ron::ser::to_string(&precision)?),
        None => {
            format!("(operations: {})", ron::ser::to_string_pretty(&chosen.operations, pretty)?)
        }
    };
    Ok(format!(
        "// Found by `precision-search {dataset} --bound {:e}`: {:.2} ms per frame, error {:.1e}.\n{body}\n",
        plan.bound,
        chosen.ms,
        chosen.error.p99()
    ))
}

/// Sizes and bound of the search.
#[derive(Clone, Debug)]
pub struct SearchPlan {
    pub components: usize,
    /// Maximum number of sampled frames.
    pub frames: usize,
    pub repeats: usize,
    /// Largest accepted [`p99`](crate::bench::paper::oracle::PosteriorErrors::p99).
    pub bound: f64,
    pub options: BenchOptions,
}

impl SearchPlan {
    /// Uses the paper's N, or a fifth of it if quick.
    ///
    /// # Errors
    /// The bound is not positive and finite.
    pub fn new(options: BenchOptions, bound: f64) -> Result<Self, ConfigError> {
        if !(bound.is_finite() && bound > 0.0) {
            return Err(ConfigError {
                setting: "bound (`--bound`)",
                expected: "a positive relative error, such as 1e-4".to_owned(),
                found: bound.to_string(),
            });
        }
        let (components, frames, repeats) =
            // More runs than in other benches: verdicts compare quartiles, which need several runs.
            if options.quick { (20_000, 6, 9) } else { (100_000, 12, 15) };
        Ok(Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            repeats: options.repeats.unwrap_or(repeats),
            bound,
            options,
        })
    }

    /// Settings shared by all combinations, with `change` applied. Reassignment is off, so that all
    /// combinations have comparable means.
    pub fn config(&self, change: PaperOverrides) -> Result<PaperConfig, ConfigError> {
        let base = PaperOverrides {
            components: Some(self.components),
            seed: Some(self.options.seed),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        PaperConfig::paper().with(&change.or(base))
    }
}

/// Time and error of one combination of widths.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PrecisionCombination {
    /// `custom` unless the combination is a named precision.
    pub precision: Precision,
    pub operations: Operations,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First and third quartiles over the runs, milliseconds per frame.
    pub ms_quartiles: [f64; 2],
    /// Errors of the posteriors against the f64 oracle.
    pub error: PosteriorErrors,
    pub within_bound: bool,
}

impl PrecisionCombination {
    /// Evaluates the runs of a configuration against the oracle's posteriors `truth`.
    pub fn new(
        config: &PaperConfig,
        runs: &Runs,
        truth: &[ComponentPosterior],
        bound: f64,
    ) -> Self {
        let ms = runs.spread(|ms| ms.train);
        let error = posterior_errors(&posteriors(&*runs.engine), truth);
        Self {
            precision: config.precision,
            operations: config.operations,
            ms: ms.median,
            ms_quartiles: ms.quartiles,
            error,
            within_bound: error.p99() <= bound,
        }
    }

    /// True if the third quartile of these runs is below the first quartile of the other's.
    pub fn is_faster_than(&self, other: &Self) -> bool {
        self.ms_quartiles[1] < other.ms_quartiles[0]
    }

    /// Median and quartiles, milliseconds per frame.
    pub fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: self.ms_quartiles }
    }
}

const WIDTHS: [Width; 2] = [Width::F64, Width::F32];
const UPDATES: [UpdateWidth; 3] = [UpdateWidth::Fixed128, UpdateWidth::Fixed64, UpdateWidth::F32];

/// All combinations of widths, widest first.
pub fn combinations() -> Vec<Operations> {
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

/// Posteriors of all components, including unused ones.
pub fn posteriors(engine: &dyn PaperLearner) -> Vec<ComponentPosterior> {
    (0..engine.components()).map(|k| engine.posterior(k)).collect()
}

/// Chooses the combination of least error among those within the bound whose quartiles overlap
/// those of the fastest one. Ties go to the widest. `None` if no combination keeps the bound.
pub fn choose(combinations: &[PrecisionCombination]) -> Option<PrecisionCombination> {
    let within = || combinations.iter().filter(|c| c.within_bound);
    let fastest = within().min_by(|a, b| a.ms.total_cmp(&b.ms))?;
    let alike = within().filter(|c| !fastest.is_faster_than(c));
    // `min_by` returns the first of equals, and the widest come first.
    alike.min_by(|a, b| a.error.p99().total_cmp(&b.error.p99())).copied()
}

#[cfg(test)]
mod combination_tests {
    use super::*;

    fn timed(update: UpdateWidth, ms: f64, error: f64) -> PrecisionCombination {
        PrecisionCombination {
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
        let chosen = |all: &[PrecisionCombination]| choose(all).map(|c| c.operations.update);
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
