//! What follows from the timed combinations: the tables, the JSON and the settings that `train
//! --preset paper --config` takes.
//!
//! A width is judged twice: alone, with all others f64, for its error, and in the fastest
//! combination that has it for its time.

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

/// The result, ready to be printed and written.
#[derive(Debug)]
pub struct PrecisionSearch {
    /// The tables and notes, as printed.
    pub text: String,
    /// The result as written to the JSON file, with its version tag.
    pub json: serde_json::Value,
    /// Settings that `train --preset paper --config` takes.
    pub ron: String,
    /// The widths chosen.
    pub operations: Operations,
}

/// What a narrower width of one operation is worth.
#[derive(Clone, Debug, Serialize)]
pub struct OperationRow {
    /// Name of the operation.
    pub operation: &'static str,
    /// Width that the row is about.
    pub width: &'static str,
    /// Error with this width alone narrower than f64.
    pub error_alone: f64,
    /// Fastest combination within the bound that has it; `None` if none is.
    pub best_ms: Option<f64>,
    /// Whether the width is worth its error.
    pub verdict: Verdict,
}

/// What the search says of one width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Verdict {
    /// Part of the result, and measurably faster than the widest.
    Chosen,
    /// Part of the result, but no faster than the widest within the spread of the runs.
    ChosenGainsNothing,
    /// No faster than the widest within the spread of the runs.
    GainsNothing,
    /// Faster than the widest, but another width is chosen.
    NotChosen,
    /// No combination with it keeps the bound.
    OutsideBound,
}

impl Verdict {
    fn sentence(self) -> &'static str {
        match self {
            Self::Chosen => "chosen",
            Self::ChosenGainsNothing => "chosen; gains nothing measurable",
            Self::GainsNothing => "gains nothing measurable",
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

/// Reads the width of one operation.
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

/// Every operation and how to read its width; the widths from wide to narrow.
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
            // The widest is held against nothing: chosen, it is not said to gain nothing.
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

/// The combination in which every other operation is the widest.
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

/// The result in all its forms.
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
        format!("The chosen widths take {gain:.2} times less time than f64 on the same f32 points.")
    } else {
        "No width is measurably faster than f64 on the same f32 points: the search gains nothing here."
            .to_owned()
    };
    let mut notes = vec![
        format!(
            "Bound {:e} on the relative error that 99 % of the evidence stays below, of means and of covariances, against f64 on {n_frames} frames of {} points, N = {}, C = 4, no reassignment, means settled by forwarded reassignment. {} combinations, {} runs in turns.",
            plan.bound,
            count(&sample.frames) / n_frames,
            plan.components,
            combinations.len(),
            plan.repeats
        ),
        result,
        format!(
            "`--precision f64`, whose points, means and index are f64 as well, takes {:.2} times as long.",
            oracle.ms / chosen.ms
        ),
    ];
    if chosen.operations.update == UpdateWidth::F32 {
        notes.push("f32 totals depend on the order of frames and drift over long runs.".to_owned());
    }
    notes
}

/// A named precision where the widths are one's, else the operations. `f64` is none of them: its
/// points and means are f64 as well.
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
        "// Found by `precision-search {dataset} --bound {:e}`: {:.2} ms a frame, error {:.1e}.\n{body}\n",
        plan.bound,
        chosen.ms,
        chosen.error.p99()
    ))
}

/// What is searched, and how thoroughly.
#[derive(Clone, Debug)]
pub struct SearchPlan {
    /// Components of every combination, the paper's N.
    pub components: usize,
    /// Sampled frames at most.
    pub frames: usize,
    /// Runs of every combination.
    pub repeats: usize,
    /// Largest [`p99`](crate::bench::paper::oracle::PosteriorErrors::p99) that is accepted.
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
            // More runs than elsewhere: verdicts compare quartiles, which few runs do not have.
            if options.quick { (20_000, 6, 9) } else { (100_000, 12, 15) };
        Ok(Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            repeats: options.repeats.unwrap_or(repeats),
            bound,
            options,
        })
    }

    /// The settings that every combination shares, with a change of its own; nothing is reassigned,
    /// so that all of them learn about the same means.
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

/// One combination of widths.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct PrecisionCombination {
    /// Name of the precision; `custom` for all but the named ones.
    pub precision: Precision,
    /// Width of every operation of the hot loop.
    pub operations: Operations,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First and third quartile over the runs.
    pub ms_quartiles: [f64; 2],
    /// Distance of the posteriors to those of the f64 oracle.
    pub error: PosteriorErrors,
    /// Whether the distance is within the bound.
    pub within_bound: bool,
}

impl PrecisionCombination {
    /// Times of the runs of a configuration, and its posteriors held against the oracle's.
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

    /// Whether three quarters of the runs are faster than three quarters of another's.
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

/// Every combination of widths, the widest first.
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

/// Posteriors of all components, used or not.
pub fn posteriors(engine: &dyn PaperLearner) -> Vec<ComponentPosterior> {
    (0..engine.components()).map(|k| engine.posterior(k)).collect()
}

/// The combination of least error among those within the bound that cannot be told from the fastest
/// one, the spreads of their runs overlapping; the widest of equals. `None` if none keeps the
/// bound.
pub fn choose(combinations: &[PrecisionCombination]) -> Option<PrecisionCombination> {
    let within = || combinations.iter().filter(|c| c.within_bound);
    let fastest = within().min_by(|a, b| a.ms.total_cmp(&b.ms))?;
    let alike = within().filter(|c| !fastest.is_faster_than(c));
    // Of equals `min_by` keeps the first, and the widest come first.
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
