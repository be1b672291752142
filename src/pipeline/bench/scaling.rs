//! Cost against points, components and threads, with the exponents that fit.

use super::axis::Axis;
use super::plot::{self, Mark, Panel, Series};
use super::runs::{median, with_threads};
use super::sample::thin;
use super::spread::Spread;
use super::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use crate::dataset::Dataset;
use crate::dataset::error::FrameError;
use crate::dataset::points::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
use crate::dataset::range;
use crate::dataset::synthetic::{self, SyntheticParams};
use crate::math::points::Points;
use crate::train::config::{
    IndexKind, Overrides, Precision, ReassignPolicy, StatisticsForm, TrainConfig,
};
use crate::train::engine::Engine;
use crate::train::init::InitialDraw;
use crate::train::timing::StageMs;
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

    fn stops(&self) -> Vec<Stop> {
        let all = rayon::current_num_threads();
        let mut threads: Vec<usize> = self.threads.iter().copied().filter(|&t| t < all).collect();
        threads.push(all);
        let at = |sweep, points, components, threads| Stop { sweep, points, components, threads };
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
pub enum Means {
    /// The paper's start: most are far from every point.
    Random,
    /// Points of other frames: the state after reassignment.
    Surface,
}

/// How a frame is processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Path {
    /// Grid, mixed precision, fused statistics.
    Fast,
    /// KD-tree, f64, unfused statistics.
    Plain,
}

struct Stop {
    sweep: Sweep,
    points: usize,
    components: usize,
    threads: usize,
}

impl Stop {
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
    pub means: Means,
    /// How the frame is processed.
    pub path: Path,
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
        Stop { sweep, points, components, threads }.position() as f64
    }

    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}

/// The power law through the medians of one line.
#[derive(Clone, Debug, Serialize)]
pub struct Fit {
    /// What grows.
    pub sweep: Sweep,
    /// Where the means lie.
    pub means: Means,
    /// How the frame is processed.
    pub path: Path,
    /// `ms ∝ size^exponent`, least squares of the logarithms; `None` below two sizes.
    pub exponent: Option<f64>,
}

/// What follows from the rows.
#[derive(Clone, Debug, Serialize)]
struct Summary {
    fits: Vec<Fit>,
    speedups: Vec<Speedup>,
}

/// One thread against two.
#[derive(Clone, Debug, Serialize)]
pub struct Speedup {
    /// Where the means lie.
    pub means: Means,
    /// How the frame is processed.
    pub path: Path,
    /// Time of one thread over that of two.
    pub two_over_one: f64,
}

const LINES: [(Means, Path); 4] = [
    (Means::Random, Path::Fast),
    (Means::Surface, Path::Fast),
    (Means::Random, Path::Plain),
    (Means::Surface, Path::Plain),
];

/// Times every combination on the synthetic room.
pub fn run(plan: &ScalingPlan, progress: Progress) -> Result<Bench, BenchError> {
    let stops = plan.stops();
    let largest = stops.iter().map(|s| s.points).max().unwrap_or(1);
    let scene = Room::load(largest, plan.options.seed)?;
    let mut rows = Vec::new();
    for (done, stop) in stops.iter().enumerate() {
        rows.extend(time_stop(stop, &scene, plan)?);
        progress(done + 1, stops.len());
    }
    let summary = Summary { fits: fits(&rows), speedups: speedups(&rows) };
    Findings {
        name: "scaling",
        dataset: "synthetic room",
        options: plan.options,
        notes: notes(plan, &summary),
        table: text(&rows),
        plot: plot::draw("Cost per frame: synthetic room, C = 4", &panels(&rows, &summary.fits))?,
        rows,
        summary,
    }
    .into_bench()
}

/// A frame to train on, and points of other frames for means on surfaces.
struct Room {
    frame: Points<f32>,
    others: Points<f32>,
}

/// Frames whose points means are drawn from.
const OTHER_FRAMES: usize = 6;

impl Room {
    fn load(n_points: usize, seed: u64) -> Result<Self, BenchError> {
        // Depth is dropped at edges: a few pixels more give the points asked for.
        let height = (1.06 * n_points as f64 * 0.75).sqrt().ceil().max(8.0);
        let params = SyntheticParams {
            width: (height / 0.75).ceil() as u32,
            height: height as u32,
            n_train: OTHER_FRAMES + 1,
            n_eval: 0,
            seed,
            depth_noise: 0.0,
        };
        let dataset = synthetic::dataset(&params)?;
        let frame = unprojected(&dataset, 0)?;
        let mut others = Points::new();
        for index in 1..=OTHER_FRAMES {
            let points = unprojected(&dataset, index)?;
            for i in 0..points.len() {
                let ([x, y, z], [r, g, b]) = (points.position(i), points.color(i));
                others.push([x, y, z, r, g, b]);
            }
            others.close_tile();
        }
        Ok(Self { frame, others })
    }

    fn draw(&self, means: Means, components: usize, seed: u64) -> InitialDraw {
        match means {
            Means::Random => InitialDraw::random(components, seed),
            Means::Surface => InitialDraw::from_points(&self.others, components, seed),
        }
    }
}

fn unprojected(dataset: &Dataset, index: usize) -> Result<Points<f32>, BenchError> {
    let range = range::estimate(dataset, 0).map_err(super::super::session::SessionError::from)?;
    let settings = UnprojectSettings {
        convention: CameraConvention::Exact,
        filter: EdgeFilter::Off,
        normalization: range.normalization(),
    };
    let mut points = Points::new();
    let loaded = dataset.load(0, index);
    let unproject = |frame| Unprojector::new().unproject(&frame, &settings, &mut points);
    loaded.and_then(unproject).map_err(|e: FrameError| BenchError::NoFrame {
        dataset: dataset.name.clone(),
        first: e.to_string(),
    })?;
    Ok(points)
}

/// Times the four lines at one stop, in turns, after one frame that warms up.
fn time_stop(stop: &Stop, room: &Room, plan: &ScalingPlan) -> Result<Vec<ScalingRow>, BenchError> {
    let frame = thin(&room.frame, stop.points);
    let times = with_threads(stop.threads, || -> Result<_, BenchError> {
        let mut engines = Vec::new();
        for (means, path) in LINES {
            let config = config(path, stop.components, plan.options.seed)?;
            let draw = room.draw(means, stop.components, plan.options.seed);
            let mut engine = Engine::new(&config, &draw)?;
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
    let row = |(i, &(means, path)): (usize, &(Means, Path))| {
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

fn config(path: Path, components: usize, seed: u64) -> Result<TrainConfig, BenchError> {
    let fast = Overrides {
        components: Some(components),
        seed: Some(seed),
        reassign: Some(ReassignPolicy::Off),
        ..Overrides::default()
    };
    let plain = Overrides {
        statistics: Some(StatisticsForm::Unfused),
        index: Some(IndexKind::KdTree),
        precision: Some(Precision::F64),
        ..fast.clone()
    };
    Ok(TrainConfig::paper().with(match path {
        Path::Fast => &fast,
        Path::Plain => &plain,
    })?)
}

fn line(rows: &[ScalingRow], sweep: Sweep, means: Means, path: Path) -> Vec<&ScalingRow> {
    rows.iter().filter(|r| (r.sweep, r.means, r.path) == (sweep, means, path)).collect()
}

fn fits(rows: &[ScalingRow]) -> Vec<Fit> {
    let sweeps = [Sweep::Points, Sweep::Components, Sweep::Threads];
    let fit = |sweep, (means, path)| {
        let line = line(rows, sweep, means, path);
        let sizes = line.iter().map(|r| (r.position(), r.ms)).collect::<Vec<_>>();
        Fit { sweep, means, path, exponent: exponent(&sizes) }
    };
    sweeps.into_iter().flat_map(|sweep| LINES.map(|line| fit(sweep, line))).collect()
}

/// Slope of the least-squares line through the logarithms; `None` where it is not defined.
fn exponent(sizes: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = sizes.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (mx, my) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let covariance: f64 = logs.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
    let variance: f64 = logs.iter().map(|(x, _)| (x - mx).powi(2)).sum();
    let slope = covariance / variance;
    slope.is_finite().then_some(slope)
}

fn speedups(rows: &[ScalingRow]) -> Vec<Speedup> {
    let speedup = |(means, path)| {
        let line = line(rows, Sweep::Threads, means, path);
        let of = |threads| line.iter().find(|r| r.threads == threads).map(|r| r.ms);
        Some(Speedup { means, path, two_over_one: of(1)? / of(2)? })
    };
    LINES.into_iter().filter_map(speedup).collect()
}

fn line_name(means: Means, path: Path) -> &'static str {
    match (means, path) {
        (Means::Random, Path::Fast) => "random means",
        (Means::Surface, Path::Fast) => "means on surfaces",
        (Means::Random, Path::Plain) => "random, plain path",
        (Means::Surface, Path::Plain) => "on surfaces, plain path",
    }
}

fn text(rows: &[ScalingRow]) -> String {
    let cells = |row: &ScalingRow| {
        [
            line_name(row.means, row.path).to_owned(),
            row.points.to_string(),
            row.components.to_string(),
            row.threads.to_string(),
            row.spread().to_string(),
            format!("{:.1}", row.plain_over_this),
        ]
    };
    let header = ["means", "points", "N", "threads", "ms/frame [quartiles]", "plain / this"];
    table::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn notes(plan: &ScalingPlan, summary: &Summary) -> Vec<String> {
    let mut notes = vec![
        format!(
            "C = 4, no reassignment, {} frames each after one that warms up, in turns. Plain path: KD-tree, f64, unfused statistics.",
            plan.repeats
        ),
        "Means on surfaces are points of six other frames.".to_owned(),
    ];
    for fit in &summary.fits {
        let Some(exponent) = fit.exponent else { continue };
        let (name, of) = (line_name(fit.means, fit.path), sweep_name(fit.sweep));
        notes.push(format!("{name}: ms grows as {of}^{exponent:.2}"));
    }
    for speedup in &summary.speedups {
        let name = line_name(speedup.means, speedup.path);
        notes.push(format!(
            "{name}: two threads are {:.2} times as fast as one",
            speedup.two_over_one
        ));
    }
    notes
}

fn sweep_name(sweep: Sweep) -> &'static str {
    match sweep {
        Sweep::Points => "points",
        Sweep::Components => "N",
        Sweep::Threads => "threads",
    }
}

fn panels(rows: &[ScalingRow], fits: &[Fit]) -> Vec<Panel> {
    let sweeps = [Sweep::Points, Sweep::Components, Sweep::Threads];
    let panel = |sweep| Panel {
        title: format!("against {}", sweep_name(sweep)),
        x: Axis::Log(match sweep {
            Sweep::Points => "points per frame".to_owned(),
            Sweep::Components => "components N".to_owned(),
            Sweep::Threads => "threads".to_owned(),
        }),
        y: Axis::Log("ms per frame".to_owned()),
        series: fits
            .iter()
            .filter(|fit| fit.sweep == sweep)
            .map(|fit| {
                let exponent = fit.exponent.map_or_else(String::new, |e| format!(": ^{e:.2}"));
                Series {
                    name: format!("{}{exponent}", line_name(fit.means, fit.path)),
                    marks: line(rows, sweep, fit.means, fit.path)
                        .into_iter()
                        .map(|r| Mark {
                            x: Spread::exact(r.position()),
                            y: r.spread(),
                            label: None,
                        })
                        .collect(),
                    connected: true,
                }
            })
            .collect(),
    };
    sweeps.into_iter().map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponents_of_power_laws() {
        let law = |x: f64| (x, 3.0 * x.powf(0.7));
        let slope = exponent(&[law(1e3), law(1e4), law(1e6)]).unwrap();
        assert!((slope - 0.7).abs() < 1e-12, "{slope}");
        assert_eq!(exponent(&[law(1e3)]), None);
    }
}
