//! Speed against error: varies one setting of a base configuration at a time. Each configuration is
//! timed, rendered and compared with the dense f64 oracle.
//!
//! A full grid would need thousands of runs. Dense reassignment appears only in the ablation, because
//! it costs a dense pass per frame. Oracle and engine start from the final means of the timed run. Few
//! random initial means ever receive a point, so a comparison from them would cover few components.

use super::oracle::{DenseOracle, Errors};
use super::runs::{Runs, TimedRow, TimedStep, time, with_threads};
use super::sample::{TrainingSample, thin};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::init::InitialDraw;
use crate::train::setting::table::SettingLayer;
use serde::Serialize;
use serde_json::json;
use std::sync::Arc;

/// Values of the swept settings, and sizes of the measurements. `frames` and `views` are upper limits.
#[derive(Clone, Debug)]
pub struct ParetoPlan {
    /// Settings of the row `base`. Each other row changes one of these settings.
    pub base: PaperOverrides,
    pub components: Vec<usize>,
    pub candidates: Vec<usize>,
    pub precisions: Vec<Precision>,
    /// Numbers of threads, besides all threads of the machine; larger numbers are skipped.
    pub threads: Vec<usize>,
    pub policies: Vec<ReassignPolicy>,
    pub frames: usize,
    pub views: usize,
    pub repeats: usize,
    /// Maximum number of point-component pairs that the oracle scores per frame.
    pub oracle_pairs: usize,
    pub options: BenchOptions,
}

/// Number of final frames that the oracle trains on.
const ORACLE_FRAMES: usize = 2;

impl ParetoPlan {
    /// Creates a plan whose base has the paper's number of components, or half of it if quick.
    pub fn new(options: BenchOptions) -> Self {
        use ReassignPolicy::{Forwarded, Off, Padded};
        let quick = options.quick;
        let base = PaperOverrides {
            components: Some(if quick { 50_000 } else { 100_000 }),
            reassign: Some(Forwarded),
            seed: Some(options.seed),
            ..PaperOverrides::default()
        };
        // The sweeps leave out the base's own values, which are in row `base`.
        let components: &[usize] =
            if quick { &[1000, 10_000, 100_000] } else { &[1000, 10_000, 30_000, 300_000] };
        let (frames, views, repeats) = if quick { (12, 4, 3) } else { (60, 12, 5) };
        Self {
            base,
            components: components.to_vec(),
            candidates: if quick { vec![1, 8] } else { vec![1, 2, 8, 16] },
            precisions: vec![Precision::F64],
            threads: vec![1, 2, 4, 8, 16, 32, 64],
            policies: vec![Off, Padded],
            frames: options.max_frames.unwrap_or(frames),
            views,
            repeats: options.repeats.unwrap_or(repeats),
            oracle_pairs: if quick { 10_000_000 } else { 50_000_000 },
            options,
        }
    }

    fn steps(&self) -> Result<Vec<TimedStep>, BenchError> {
        let all = rayon::current_num_threads();
        let none = PaperOverrides::default;
        let mut changes = vec![("base", "base".to_owned(), none(), all)];
        changes.extend(self.components.iter().map(|&n| {
            ("N", format!("N {n}"), PaperOverrides { components: Some(n), ..none() }, all)
        }));
        changes.extend(self.candidates.iter().map(|&c| {
            let candidates = Some(Candidates::Nearest(c));
            ("C", format!("C {c}"), PaperOverrides { candidates, ..none() }, all)
        }));
        changes.extend(self.precisions.iter().map(|precision| {
            let change = PaperOverrides { precision: Some(*precision), ..none() };
            ("precision", named(precision), change, all)
        }));
        // The base already uses all threads.
        changes.extend(self.threads.iter().filter(|&&t| t < all).map(|&threads| {
            let plural = if threads == 1 { "" } else { "s" };
            ("threads", format!("{threads} thread{plural}"), none(), threads)
        }));
        changes.extend(self.policies.iter().map(|policy| {
            let change = PaperOverrides { reassign: Some(*policy), ..none() };
            ("reassign", format!("reassign {}", named(policy)), change, all)
        }));
        let step = |(sweep, name, change, threads): (_, _, PaperOverrides, _)| {
            let config = PaperConfig::paper().with(&change.or(self.base.clone()))?;
            // One sweep varies N, so each configuration draws its own means.
            let draw = InitialDraw::random(config.components, config.seed);
            Ok(TimedStep { sweep, name, config, threads, draw, is_thinned: false })
        };
        changes.into_iter().map(step).collect()
    }
}

/// Formats a setting in the spelling of settings files.
fn named(setting: &impl Serialize) -> String {
    // Settings without data serialise as their name.
    let json = serde_json::to_value(setting).ok();
    json.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

pub fn run(
    plan: &ParetoPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let sample = TrainingSample::load(dataset, plan.frames, plan.views)?;
    let steps = plan.steps()?;
    let errors = |step: &TimedStep, runs: &Runs| {
        let errors = || errors(&step.config, runs, &sample, plan.oracle_pairs);
        with_threads(step.threads, errors)?.map(Some)
    };
    let rows = time(&steps, &sample, &[], plan.repeats, progress, errors)?;
    let is_front = front(&rows);
    let names = rows.iter().zip(&is_front).filter(|(_, is_front)| **is_front);
    let summary = json!({ "front": names.map(|(row, _)| &row.configuration).collect::<Vec<_>>() });
    let title =
        format!("Speed against error: {}, base {}", sample.dataset.name, base_name(&rows[0]));
    Findings {
        name: "pareto",
        dataset: &sample.dataset.name,
        adapter: None,
        options: plan.options,
        notes: notes(plan, &sample, &rows[0]),
        table: text(&rows, &is_front),
        plot: plot::draw(&title, &panels(&rows))?,
        rows,
        summary,
    }
    .into_bench()
}

/// Compares an engine with the oracle, both trained from the final means of the timed run. Reassignment
/// has distributed these means over the scene.
fn errors(
    config: &PaperConfig,
    runs: &Runs,
    sample: &TrainingSample,
    oracle_pairs: usize,
) -> Result<Errors, BenchError> {
    let state = runs.engine.state();
    let draw = InitialDraw { means: state.means.rows(), alpha: state.alpha_init };
    let last = sample.frames.len().saturating_sub(ORACLE_FRAMES);
    let frames: Vec<Points<f32>> = sample.frames[last..]
        .iter()
        // The oracle scores every point with every component.
        .map(|frame| thin(frame, oracle_pairs / config.components))
        .collect();
    DenseOracle::new(config, &draw, &frames)?.errors_of(config)
}

/// Marks the Pareto front: rows on all threads that no other row on all threads beats in both time and
/// PSNR.
fn front(rows: &[TimedRow]) -> Vec<bool> {
    // Rows with fewer threads show the speed-up by threads. They are never the best choice.
    let most = rows.iter().map(|row| row.threads).max().unwrap_or(0);
    let on_all = || rows.iter().filter(|row| row.threads == most);
    // Strict, so that two equal rows are both on the front.
    let is_beaten = |row: &TimedRow| on_all().any(|r| r.ms < row.ms && r.psnr > row.psnr);
    rows.iter().map(|row| row.threads == most && !is_beaten(row)).collect()
}

fn base_name(base: &TimedRow) -> String {
    let candidates = match base.candidates {
        Candidates::Dense => "dense".to_owned(),
        Candidates::Nearest(n) => n.to_string(),
    };
    let [precision, reassign] = [named(&base.precision), named(&base.reassign)];
    format!("N = {}, C = {candidates}, {precision}, {reassign}", base.components)
}

fn text(rows: &[TimedRow], is_front: &[bool]) -> String {
    let error = |error: Option<f64>| error.map_or_else(String::new, report::error);
    // Not by `table`: the front is a property of all rows together.
    let cells = |(row, is_front): (&TimedRow, &bool)| {
        [
            row.configuration.clone(),
            row.spread().to_string(),
            format!("{:.2}", row.psnr),
            error(row.elbo_diff_max),
            error(row.elbo_diff_mean),
            error(row.total_variation_mean),
            error(row.mean_error_p99),
            error(row.covariance_error_p99),
            if *is_front { "*" } else { "" }.to_owned(),
        ]
    };
    let header = [
        "setting",
        "ms/frame [quartiles]",
        "PSNR dB",
        "ELBO max",
        "ELBO mean",
        "TV",
        "mean",
        "covariance",
        "front",
    ];
    report::text(header, &rows.iter().zip(is_front).map(cells).collect::<Vec<_>>())
}

fn notes(plan: &ParetoPlan, sample: &TrainingSample, base: &TimedRow) -> Vec<String> {
    vec![
        format!(
            "base: {}, {} threads. Each other row changes one setting. {} frames, {} runs in turns; the time of a run is the median over its frames without the first.",
            base_name(base),
            base.threads,
            sample.frames.len(),
            plan.repeats
        ),
        format!(
            "Errors are differences from the dense f64 oracle. Both start from the row's final means, on about {} points (at this N) of each of the last {ORACLE_FRAMES} frames. ELBO: nats. TV: mean total variation of responsibilities. mean, covariance: relative errors of the posterior, 99 % quantile by evidence.",
            plan.oracle_pairs / base.components
        ),
        format!(
            "PSNR: projected renderer, {} held-out views. Dense reassignment is measured only by `bench ablation`. front: no row is both faster and better in PSNR.",
            sample.n_views()
        ),
    ]
}

fn panels(rows: &[TimedRow]) -> [Panel; 2] {
    let panel = |title: &str, y: Axis, value: fn(&TimedRow) -> f64| {
        let mark = |row: &TimedRow| {
            let (x, y) = (row.spread(), Spread::exact(value(row)));
            Mark { x, y, label: Some(row.configuration.clone()) }
        };
        let sweep = |rows: &[TimedRow]| Series {
            name: rows[0].sweep.to_owned(),
            marks: rows.iter().map(mark).collect(),
            connected: false,
        };
        let x = Axis::Log("ms per frame (median, quartiles)");
        // Rows of one sweep are adjacent, as `steps` lists them.
        let series = rows.chunk_by(|a, b| a.sweep == b.sweep).map(sweep).collect();
        Panel { title: title.to_owned(), x, y, series }
    };
    let error = Axis::Log("relative error of covariances (99 %)");
    [
        panel("quality", Axis::Linear("PSNR, dB"), |r| r.psnr),
        panel("distance from the dense f64 oracle", error, |r| {
            // The plot leaves out marks that are not finite.
            r.covariance_error_p99.unwrap_or(f64::NAN)
        }),
    ]
}
