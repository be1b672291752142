//! Cost against points, components and threads, with the exponents that fit.

mod report;
mod room;

pub use report::{Fit, Speedup};

use super::runs::{median, with_threads};
use super::sample::thin;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::draw;
use crate::eval::spread::Spread;
use crate::train::paper::config::{
    IndexKind, PaperConfig, PaperOverrides, Precision, ReassignPolicy, StatisticsForm,
};
use crate::train::paper::engine::PaperEngine;
use crate::train::timing::StageMs;
use report::{ScalingSummary, notes, panels, text};
use room::RoomFrames;
use serde::Serialize;

/// Which sizes are timed.
#[derive(Clone, Debug)]
pub struct ScalingPlan {
    /// Points of a frame.
    pub points: Vec<usize>,
    /// Components.
    pub components: Vec<usize>,
    /// Threads; those above the machine's are left out.
    pub threads: Vec<usize>,
    /// Points where they are not swept.
    pub base_points: usize,
    /// Components where they are not swept.
    pub base_components: usize,
    /// Timed frames of every stop.
    pub repeats: usize,
    /// What was asked for.
    pub options: BenchOptions,
}

impl ScalingPlan {
    /// Up to 2·10⁵ points and 10⁶ components, or 3·10⁵ in the quick form.
    pub fn new(options: BenchOptions) -> Self {
        let mut components = vec![1000, 3000, 10_000, 30_000, 100_000, 300_000];
        if !options.quick {
            components.push(1_000_000);
        }
        let points: &[usize] = if options.quick {
            &[10_000, 50_000, 200_000]
        } else {
            &[10_000, 20_000, 50_000, 100_000, 200_000]
        };
        Self {
            points: points.to_vec(),
            components,
            threads: vec![1, 2, 4, 8, 16, 32, 64],
            base_points: if options.quick { 50_000 } else { 100_000 },
            base_components: 100_000,
            repeats: options.repeats.unwrap_or(if options.quick { 5 } else { 15 }),
            options,
        }
    }

    fn stops(&self) -> Vec<ScalingPoint> {
        let all = rayon::current_num_threads();
        let mut threads: Vec<usize> = self.threads.iter().copied().filter(|&t| t < all).collect();
        threads.push(all);
        let at = |sweep, points, components, threads| ScalingPoint {
            sweep,
            points,
            components,
            threads,
        };
        let (p, n) = (self.base_points, self.base_components);
        let by_points = self.points.iter().map(|&points| at(Sweep::Points, points, n, all));
        let by_components = self.components.iter().map(|&n| at(Sweep::Components, p, n, all));
        let by_threads = threads.into_iter().map(|t| at(Sweep::Threads, p, n, t));
        by_points.chain(by_components).chain(by_threads).collect()
    }
}

/// What grows.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// Points of a frame.
    Points,
    /// Components.
    Components,
    /// Threads.
    Threads,
}

/// Where the initial means lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanPlacement {
    /// The paper's start: most are far from every point.
    Random,
    /// Points of other frames: the state after reassignment.
    Surface,
}

/// How a frame is processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnginePath {
    /// Grid, mixed precision, fused statistics.
    Fast,
    /// KD-tree, f64, unfused statistics.
    Plain,
}

struct ScalingPoint {
    sweep: Sweep,
    points: usize,
    components: usize,
    threads: usize,
}

impl ScalingPoint {
    fn position(&self) -> usize {
        match self.sweep {
            Sweep::Points => self.points,
            Sweep::Components => self.components,
            Sweep::Threads => self.threads,
        }
    }
}

/// One timed combination.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    /// What grows from row to row.
    pub sweep: Sweep,
    /// Points of the frame.
    pub points: usize,
    /// Components.
    pub components: usize,
    /// Threads.
    pub threads: usize,
    /// Where the means lie.
    pub means: MeanPlacement,
    /// How the frame is processed.
    pub path: EnginePath,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First quartile.
    pub ms_q1: f64,
    /// Third quartile.
    pub ms_q3: f64,
    /// Candidate search.
    pub candidates_ms: f64,
    /// Scores and responsibilities.
    pub e_step_ms: f64,
    /// Sums.
    pub stats_ms: f64,
    /// Addition to the totals.
    pub update_ms: f64,
    /// Times that the plain path takes longer, in the same run.
    pub plain_over_this: f64,
}

impl ScalingRow {
    fn position(&self) -> f64 {
        let Self { sweep, points, components, threads, .. } = *self;
        ScalingPoint { sweep, points, components, threads }.position() as f64
    }

    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}

const LINES: [(MeanPlacement, EnginePath); 4] = [
    (MeanPlacement::Random, EnginePath::Fast),
    (MeanPlacement::Surface, EnginePath::Fast),
    (MeanPlacement::Random, EnginePath::Plain),
    (MeanPlacement::Surface, EnginePath::Plain),
];

/// Times every combination on the synthetic room.
pub fn run(plan: &ScalingPlan, progress: Progress) -> Result<Bench, BenchError> {
    let stops = plan.stops();
    let largest = stops.iter().map(|s| s.points).max().unwrap_or(1);
    let scene = RoomFrames::load(largest, plan.options.seed)?;
    let mut rows = Vec::new();
    for (done, stop) in stops.iter().enumerate() {
        rows.extend(time_stop(stop, &scene, plan)?);
        progress(done + 1, stops.len());
    }
    let summary = ScalingSummary::of(&rows);
    Findings {
        name: "scaling",
        dataset: "synthetic room",
        adapter: None,
        options: plan.options,
        notes: notes(plan, &summary),
        table: text(&rows),
        plot: draw::draw("Cost per frame: synthetic room, C = 4", &panels(&rows, &summary.fits))?,
        rows,
        summary,
    }
    .into_bench()
}

/// Times the four lines at one stop, in turns, after one frame that warms up.
fn time_stop(
    stop: &ScalingPoint,
    room: &RoomFrames,
    plan: &ScalingPlan,
) -> Result<Vec<ScalingRow>, BenchError> {
    let frame = thin(&room.frame, stop.points);
    let times = with_threads(stop.threads, || -> Result<_, BenchError> {
        let mut engines = Vec::new();
        for (means, path) in LINES {
            let config = config(path, stop.components, plan.options.seed)?;
            let draw = room.draw(means, stop.components, plan.options.seed);
            let mut engine = PaperEngine::new(&config, &draw)?;
            engine.train(&frame)?;
            engines.push(engine);
        }
        let mut times: [Vec<StageMs>; LINES.len()] = Default::default();
        for _ in 0..plan.repeats.max(1) {
            for (engine, times) in engines.iter_mut().zip(&mut times) {
                times.push(engine.train(&frame)?.ms);
            }
        }
        Ok(times)
    })??;
    let total = |i: usize| Spread::of(times[i].iter().map(|ms| ms.train).collect());
    let row = |(i, &(means, path)): (usize, &(MeanPlacement, EnginePath))| {
        let (ms, stages) = (total(i), median(&times[i]));
        // The plain lines follow the fast ones in the same order of means.
        let plain = total(i % 2 + 2);
        ScalingRow {
            sweep: stop.sweep,
            points: frame.len(),
            components: stop.components,
            threads: stop.threads,
            means,
            path,
            ms: ms.median,
            ms_q1: ms.quartiles[0],
            ms_q3: ms.quartiles[1],
            candidates_ms: stages.candidates,
            e_step_ms: stages.e_step,
            stats_ms: stages.stats,
            update_ms: stages.update,
            plain_over_this: plain.median / ms.median,
        }
    };
    Ok(LINES.iter().enumerate().map(row).collect())
}

fn config(path: EnginePath, components: usize, seed: u64) -> Result<PaperConfig, BenchError> {
    let fast = PaperOverrides {
        components: Some(components),
        seed: Some(seed),
        reassign: Some(ReassignPolicy::Off),
        ..Overrides::default()
    };
    let plain = PaperOverrides {
        statistics: Some(StatisticsForm::Unfused),
        index: Some(IndexKind::KdTree),
        precision: Some(Precision::F64),
        ..fast.clone()
    };
    Ok(PaperConfig::paper().with(match path {
        EnginePath::Fast => &fast,
        EnginePath::Plain => &plain,
    })?)
}
