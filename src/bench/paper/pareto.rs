//! Speed against error: varies one setting of a base configuration at a time. Each configuration is
//! timed, rendered and compared with the dense f64 oracle.
//!
//! A full grid would need thousands of runs. Dense reassignment appears only in the ablation,
//! because it costs a dense pass per frame. Oracle and engine start from the final means of the
//! timed run: few fresh random means ever receive a point, so they would compare little.

use super::ablation::batch_name;
use super::oracle::{DenseOracle, Errors};
use super::runs;
use super::runs::{Runs, TimedConfiguration, with_threads};
use super::sample::{TrainingSample, thin};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Batch, Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::init::InitialDraw;
use crate::train::setting::table::SettingLayer;
use serde::Serialize;
use std::sync::Arc;

/// Values and sizes of the sweeps. `frames` and `views` are maxima.
#[derive(Clone, Debug)]
pub struct ParetoPlan {
    /// Configuration of which every sweep varies one setting.
    pub base: PaperOverrides,
    pub components: Vec<usize>,
    pub candidates: Vec<usize>,
    pub batches: Vec<Batch>,
    pub precisions: Vec<Precision>,
    /// Values above the machine's number of threads are skipped.
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
    /// Base with the paper's N, or half of it if quick.
    pub fn new(options: BenchOptions) -> Self {
        use ReassignPolicy::{Forwarded, Off, Padded, Truncated};
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
            batches: [256, 4096, 65_536].map(Batch::Points).to_vec(),
            precisions: vec![Precision::F64, Precision::F32],
            threads: vec![1, 2, 4, 8, 16, 32, 64],
            policies: vec![Off, Truncated, Padded],
            frames: options.max_frames.unwrap_or(frames),
            views,
            repeats: options.repeats.unwrap_or(repeats),
            oracle_pairs: if quick { 10_000_000 } else { 50_000_000 },
            options,
        }
    }

    /// The base and every configuration of the sweeps.
    fn stops(&self) -> Result<Vec<SweepPoint>, BenchError> {
        let all_threads = rayon::current_num_threads();
        let mut stops = Vec::new();
        let mut add =
            |sweep, name: String, change: PaperOverrides, threads| -> Result<(), BenchError> {
                let config = PaperConfig::paper().with(&change.or(self.base.clone()))?;
                // One sweep varies N, so each configuration draws its own means.
                let draw = InitialDraw::random(config.components, config.seed);
                stops.push(SweepPoint { sweep, name, config, draw, threads });
                Ok(())
            };
        let none = PaperOverrides::default;
        add("base", "base".to_owned(), none(), all_threads)?;
        for &n in &self.components {
            let change = PaperOverrides { components: Some(n), ..none() };
            add("N", format!("N {n}"), change, all_threads)?;
        }
        for &c in &self.candidates {
            let change = PaperOverrides { candidates: Some(Candidates::Nearest(c)), ..none() };
            add("C", format!("C {c}"), change, all_threads)?;
        }
        for &batch in &self.batches {
            let change = PaperOverrides { batch: Some(batch), ..none() };
            add("batch", format!("batch {}", batch_name(batch)), change, all_threads)?;
        }
        for &precision in &self.precisions {
            let change = PaperOverrides { precision: Some(precision), ..none() };
            add("precision", named(&precision), change, all_threads)?;
        }
        // The base already uses all threads.
        for &threads in self.threads.iter().filter(|&&t| t < all_threads) {
            add(
                "threads",
                match threads {
                    1 => "1 thread".to_owned(),
                    n => format!("{n} threads"),
                },
                none(),
                threads,
            )?;
        }
        for &policy in &self.policies {
            let change = PaperOverrides { reassign: Some(policy), ..none() };
            add("reassign", format!("reassign {}", named(&policy)), change, all_threads)?;
        }
        Ok(stops)
    }
}

/// Formats a setting as in settings files.
fn named(setting: &impl Serialize) -> String {
    let json = serde_json::to_value(setting).ok();
    json.and_then(|v| v.as_str().map(str::to_owned)).unwrap_or_default()
}

struct SweepPoint {
    sweep: &'static str,
    name: String,
    config: PaperConfig,
    draw: InitialDraw,
    threads: usize,
}

impl SweepPoint {
    fn variant<'a>(&'a self, sample: &'a TrainingSample) -> TimedConfiguration<'a> {
        let Self { config, draw, threads, .. } = self;
        TimedConfiguration {
            config: config.clone(),
            threads: *threads,
            draw,
            frames: &sample.frames,
        }
    }
}

/// One configuration of a sweep. Times are medians over the runs, in milliseconds per frame. Errors
/// are differences from the oracle.
#[derive(Clone, Debug, Serialize)]
pub struct ParetoRow {
    /// Name of the varied setting.
    pub sweep: String,
    /// Varied setting with its value.
    pub setting: String,
    pub components: usize,
    pub candidates: Candidates,
    /// Points processed at once.
    pub batch: Batch,
    pub precision: Precision,
    pub reassign: ReassignPolicy,
    pub threads: usize,
    pub ms: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Candidate search.
    pub candidates_ms: f64,
    /// Scores and responsibilities.
    pub e_step_ms: f64,
    /// Sums per tile.
    pub stats_ms: f64,
    /// Adding the sums to the totals.
    pub update_ms: f64,
    /// Selecting and moving components.
    pub reassign_ms: f64,
    /// Mean PSNR of the held-out views, dB.
    pub psnr: f64,
    /// Largest ELBO difference of a point, nats.
    pub elbo_diff_max: f64,
    /// Mean ELBO difference of a point, nats.
    pub elbo_diff_mean: f64,
    /// Mean over the points of the total variation of their responsibilities.
    pub total_variation_mean: f64,
    pub total_variation_max: f64,
    /// 99 % quantile of the relative error of posterior means, weighted by evidence.
    pub mean_error_p99: f64,
    pub mean_error_max: f64,
    /// 99 % quantile of the relative error of posterior covariances, weighted by evidence.
    pub covariance_error_p99: f64,
    pub covariance_error_max: f64,
    /// True if no other configuration on all threads is both faster and higher in PSNR.
    pub on_front: bool,
}

impl ParetoRow {
    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}

pub fn run(
    plan: &ParetoPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let sample = TrainingSample::load(dataset, plan.frames, plan.views)?;
    let stops = plan.stops()?;
    let variants: Vec<TimedConfiguration> =
        stops.iter().map(|stop| stop.variant(&sample)).collect();
    // One extra step per configuration for its views and the oracle.
    let steps = (plan.repeats.max(1) + 1) * stops.len();
    let mut done = 0;
    let mut step = || {
        done += 1;
        progress(done, steps);
    };
    let timed = runs::in_turns(&variants, plan.repeats, &mut step)?;
    let mut rows = Vec::with_capacity(stops.len());
    for (stop, runs) in stops.iter().zip(&timed) {
        rows.push(measured(stop, runs, &sample, plan.oracle_pairs)?);
        step();
    }
    mark_front(&mut rows);
    let title =
        format!("Speed against error: {}, base {}", sample.dataset.name, base_name(&rows[0]));
    Findings {
        name: "pareto",
        dataset: &sample.dataset.name,
        adapter: None,
        options: plan.options,
        notes: notes(plan, &sample, &rows[0]),
        table: text(&rows),
        plot: plot::draw(&title, &panels(&rows))?,
        rows,
        summary: (),
    }
    .into_bench()
}

fn measured(
    stop: &SweepPoint,
    runs: &Runs,
    sample: &TrainingSample,
    oracle_pairs: usize,
) -> Result<ParetoRow, BenchError> {
    let SweepPoint { sweep, name, config, threads, .. } = stop;
    let ms = runs.spread(|ms| ms.train);
    let [candidates_ms, e_step_ms, stats_ms, update_ms, reassign_ms] = runs.stages();
    let errors = with_threads(*threads, || errors(config, runs, sample, oracle_pairs))??;
    Ok(ParetoRow {
        sweep: (*sweep).to_owned(),
        setting: name.clone(),
        components: config.components,
        candidates: config.candidates,
        batch: config.batch,
        precision: config.precision,
        reassign: config.reassign,
        threads: *threads,
        ms: ms.median,
        ms_q1: ms.quartiles[0],
        ms_q3: ms.quartiles[1],
        candidates_ms,
        e_step_ms,
        stats_ms,
        update_ms,
        reassign_ms,
        psnr: sample.psnr(&*runs.engine, config)?,
        elbo_diff_max: errors.elbo_max,
        elbo_diff_mean: errors.elbo_mean,
        total_variation_mean: errors.variation_mean,
        total_variation_max: errors.variation_max,
        mean_error_p99: errors.posterior.mean_p99,
        mean_error_max: errors.posterior.mean_max,
        covariance_error_p99: errors.posterior.covariance_p99,
        covariance_error_max: errors.posterior.covariance_max,
        on_front: false,
    })
}

/// Runs engine and oracle from the final means of the timed run, which reassignment has spread out.
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
        .map(|frame| thin(frame, oracle_pairs / config.components))
        .collect();
    DenseOracle::new(config, &draw, &frames)?.errors_of(config)
}

fn mark_front(rows: &mut [ParetoRow]) {
    let all: Vec<(usize, f64, f64)> = rows.iter().map(|r| (r.threads, r.ms, r.psnr)).collect();
    let most = all.iter().map(|a| a.0).max().unwrap_or(0);
    for row in rows {
        let beaten = |&(threads, ms, psnr): &(usize, f64, f64)| {
            threads == most && ms < row.ms && psnr > row.psnr
        };
        // Rows with fewer threads show the speed-up by threads. They are never the best choice.
        row.on_front = row.threads == most && !all.iter().any(beaten);
    }
}

fn base_name(base: &ParetoRow) -> String {
    let candidates = match base.candidates {
        Candidates::Dense => "dense".to_owned(),
        Candidates::Nearest(n) => n.to_string(),
    };
    format!(
        "N = {}, C = {candidates}, {}, {}",
        base.components,
        named(&base.precision),
        named(&base.reassign)
    )
}

fn text(rows: &[ParetoRow]) -> String {
    let cells = |row: &ParetoRow| {
        [
            row.setting.clone(),
            row.spread().to_string(),
            format!("{:.2}", row.psnr),
            report::error(row.elbo_diff_max),
            report::error(row.elbo_diff_mean),
            report::error(row.total_variation_mean),
            report::error(row.mean_error_p99),
            report::error(row.covariance_error_p99),
            if row.on_front { "*" } else { "" }.to_owned(),
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
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn notes(plan: &ParetoPlan, sample: &TrainingSample, base: &ParetoRow) -> Vec<String> {
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

fn panels(rows: &[ParetoRow]) -> [Panel; 2] {
    let mut sweeps: Vec<&str> = rows.iter().map(|r| r.sweep.as_str()).collect();
    sweeps.dedup();
    let panel = |title: &str, y: Axis, value: &dyn Fn(&ParetoRow) -> f64| Panel {
        title: title.to_owned(),
        x: Axis::Log("ms per frame (median, quartiles)".to_owned()),
        y,
        series: sweeps
            .iter()
            .map(|&sweep| Series {
                name: sweep.to_owned(),
                marks: rows
                    .iter()
                    .filter(|r| r.sweep == sweep)
                    .map(|r| Mark {
                        x: r.spread(),
                        y: Spread::exact(value(r)),
                        label: Some(r.setting.clone()),
                    })
                    .collect(),
                connected: false,
            })
            .collect(),
    };
    [
        panel("quality", Axis::Linear("PSNR, dB".to_owned()), &|r| r.psnr),
        panel(
            "distance from the dense f64 oracle",
            Axis::Log("relative error of covariances (99 %)".to_owned()),
            &|r| r.covariance_error_p99,
        ),
    ]
}
