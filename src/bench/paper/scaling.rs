//! Cost per frame against points, components and threads, with fitted exponents.
//!
//! Exponents are slopes of straight lines through logarithms. Over two decades a cost `a + b·n`
//! deviates from a power law, but the slope still distinguishes linear from quadratic.

use super::runs;
use super::runs::{Runs, TimedConfiguration};
use super::sample::{TrainingSample, push_tile, thin};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::synthetic;
use crate::dataset::synthetic::SyntheticParams;
use crate::eval::metrics::Spread;
use crate::observation::points::Points;
use crate::train::paper::config::{PaperConfig, PaperOverrides, Precision, ReassignPolicy};
use crate::train::paper::init::InitialDraw;
use serde::Serialize;
use serde_json::json;
use std::sync::Arc;
use strum::{Display, IntoStaticStr};

#[derive(Clone, Debug)]
pub struct ScalingPlan {
    pub points: Vec<usize>,
    pub components: Vec<usize>,
    /// Numbers of threads, besides all threads of the machine; larger numbers are skipped.
    pub threads: Vec<usize>,
    /// Number of points per frame while components or threads are varied.
    pub base_points: usize,
    /// Number of components while points or threads are varied.
    pub base_components: usize,
    /// Number of runs per size. Each run has a warm-up frame and `TIMED_FRAMES` timed ones.
    pub repeats: usize,
    pub options: BenchOptions,
}

const TIMED_FRAMES: usize = 3;
/// Number of frames whose points serve as initial means on surfaces.
const OTHER_FRAMES: usize = 6;

impl ScalingPlan {
    /// Creates a plan with up to 2·10⁵ points and 10⁶ components (3·10⁵ if quick).
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
            repeats: options.repeats.unwrap_or(if options.quick { 3 } else { 5 }),
            options,
        }
    }

    fn stops(&self) -> Vec<ScalingPoint> {
        let all = rayon::current_num_threads();
        let mut threads: Vec<usize> = self.threads.iter().copied().filter(|&t| t < all).collect();
        // No more threads than the machine has: that would measure its scheduler.
        threads.push(all);
        let (points, components) = (self.base_points, self.base_components);
        let base = |sweep| ScalingPoint { sweep, points, components, threads: all };
        let with_points = |&points| ScalingPoint { points, ..base(Sweep::Points) };
        let with_components = |&components| ScalingPoint { components, ..base(Sweep::Components) };
        let with_threads = |threads| ScalingPoint { threads, ..base(Sweep::Threads) };
        let by_points = self.points.iter().map(with_points);
        let by_components = self.components.iter().map(with_components);
        by_points.chain(by_components).chain(threads.into_iter().map(with_threads)).collect()
    }
}

struct ScalingPoint {
    sweep: Sweep,
    points: usize,
    components: usize,
    threads: usize,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Display, IntoStaticStr)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    #[strum(to_string = "points")]
    Points,
    #[strum(to_string = "N")]
    Components,
    #[strum(to_string = "threads")]
    Threads,
}

const SWEEPS: [Sweep; 3] = [Sweep::Points, Sweep::Components, Sweep::Threads];

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanPlacement {
    /// Random means, as in the paper; most are far from every point.
    Random,
    /// Means on points of other frames, as after reassignment.
    Surface,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnginePath {
    /// Fused kernels in mixed precision.
    Fast,
    /// Plain engine in f64.
    Plain,
}

/// Line of the plot: placement of the means, engine and name.
type Line = (MeanPlacement, EnginePath, &'static str);

const LINES: [Line; 4] = [
    (MeanPlacement::Random, EnginePath::Fast, "random means"),
    (MeanPlacement::Surface, EnginePath::Fast, "means on surfaces"),
    (MeanPlacement::Random, EnginePath::Plain, "random, plain path"),
    (MeanPlacement::Surface, EnginePath::Plain, "on surfaces, plain path"),
];

/// One timed combination. Times are medians per frame in milliseconds, with quartiles over the runs.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    pub sweep: Sweep,
    pub points: usize,
    pub components: usize,
    pub threads: usize,
    pub means: MeanPlacement,
    pub path: EnginePath,
    pub ms: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    pub candidates_ms: f64,
    pub e_step_ms: f64,
    pub stats_ms: f64,
    pub update_ms: f64,
    /// Speed-up over the plain path: its median time with the same means, divided by the median time of
    /// this row.
    pub plain_over_this: f64,
}

impl ScalingRow {
    /// Returns the position on the x axis, which is the varied size.
    fn position(&self) -> f64 {
        let size = match self.sweep {
            Sweep::Points => self.points,
            Sweep::Components => self.components,
            Sweep::Threads => self.threads,
        };
        size as f64
    }

    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}

#[derive(Clone, Debug, Serialize)]
struct Fit {
    sweep: Sweep,
    means: MeanPlacement,
    path: EnginePath,
    /// Exponent of the power law `ms ∝ size^exponent`, fitted by least squares to the logarithms. `None`
    /// for fewer than two sizes.
    exponent: Option<f64>,
}

pub fn run(plan: &ScalingPlan, progress: Progress) -> Result<Bench, BenchError> {
    let stops = plan.stops();
    let largest = stops.iter().map(|s| s.points).max().unwrap_or(1);
    // Render once at the largest size. Smaller sizes thin the same frame, so that only the size
    // differs.
    let room = RoomFrames::load(largest, plan.options.seed)?;
    let mut rows = Vec::new();
    for (done, stop) in stops.iter().enumerate() {
        rows.extend(time_stop(stop, &room, plan)?);
        progress(done + 1, stops.len());
    }
    let fits = fits(&rows);
    Findings {
        name: "scaling",
        dataset: "synthetic room",
        adapter: None,
        options: plan.options,
        notes: notes(plan, &rows, &fits),
        table: text(&rows),
        plot: plot::draw("Cost per frame: synthetic room, C = 4", &panels(&rows, &fits))?,
        rows,
        summary: json!({ "fits": fits }),
    }
    .into_bench()
}

/// Times all lines of the plot at one size, in turns.
fn time_stop(
    stop: &ScalingPoint,
    room: &RoomFrames,
    plan: &ScalingPlan,
) -> Result<Vec<ScalingRow>, BenchError> {
    // Repeated training on the same frame costs the same each time: without reassignment the
    // E-step reads a model that never changes (`model.md`, Three models).
    let frames = vec![thin(&room.frame, stop.points); 1 + TIMED_FRAMES];
    let seed = plan.options.seed;
    let draws = [MeanPlacement::Random, MeanPlacement::Surface].map(|means| match means {
        MeanPlacement::Random => InitialDraw::random(stop.components, seed),
        MeanPlacement::Surface => InitialDraw::from_points(&room.others, stop.components, seed),
    });
    let variant = |(means, path, _): Line| -> Result<_, BenchError> {
        let overrides = PaperOverrides {
            components: Some(stop.components),
            seed: Some(seed),
            reassign: Some(ReassignPolicy::Off),
            // Precision f64 selects the plain engine.
            precision: (path == EnginePath::Plain).then_some(Precision::F64),
            ..PaperOverrides::default()
        };
        let config = PaperConfig::paper().with(&overrides)?;
        let (threads, draw) = (stop.threads, &draws[means as usize]);
        Ok(TimedConfiguration { config, threads, draw, frames: &frames })
    };
    let variants = LINES.into_iter().map(variant).collect::<Result<Vec<_>, _>>()?;
    let timed = runs::in_turns(&variants, plan.repeats, &mut || ())?;
    let total = |runs: &Runs| runs.spread(|ms| ms.train);
    let row = |(i, (means, path, _)): (usize, Line)| {
        let ms = total(&timed[i]);
        // The last stage is reassignment, which is off.
        let [candidates_ms, e_step_ms, stats_ms, update_ms, _] = timed[i].stages();
        // The plain lines are the second half of `LINES`, in the same order of means.
        let plain = total(&timed[i % 2 + 2]);
        ScalingRow {
            sweep: stop.sweep,
            points: frames[0].len(),
            components: stop.components,
            threads: stop.threads,
            means,
            path,
            ms: ms.median,
            ms_q1: ms.quartiles[0],
            ms_q3: ms.quartiles[1],
            candidates_ms,
            e_step_ms,
            stats_ms,
            update_ms,
            plain_over_this: plain.median / ms.median,
        }
    };
    Ok(LINES.into_iter().enumerate().map(row).collect())
}

/// Frame to train on, and points of other frames that serve as initial means on surfaces.
struct RoomFrames {
    frame: Points<f32>,
    others: Points<f32>,
}

impl RoomFrames {
    /// Renders frames of the synthetic room with at least `n_points` points each.
    fn load(n_points: usize, seed: u64) -> Result<Self, BenchError> {
        // Points are dropped at edges of depth, so render more pixels than requested points.
        let height = (1.2 * n_points as f64 * 0.75).sqrt().ceil().max(8.0);
        let params = SyntheticParams {
            // The room's images have an aspect of 4 to 3.
            width: (height / 0.75).ceil() as u32,
            height: height as u32,
            n_train: OTHER_FRAMES + 1,
            n_eval: 1,
            seed,
            depth_noise: 0.0,
            ..SyntheticParams::demo()
        };
        let dataset = Arc::new(synthetic::dataset(&params)?);
        // Nothing is rendered here, so one view is enough.
        let mut frames = TrainingSample::load(dataset, OTHER_FRAMES + 1, 1)?.frames.into_iter();
        // Never empty: `load` fails without a usable frame.
        let frame = frames.next().unwrap_or_default();
        let mut others = Points::new();
        for points in frames {
            // One tile of any size will do: means are drawn from single points.
            push_tile(&mut others, &points, 0..points.len());
        }
        Ok(Self { frame, others })
    }
}

fn line(rows: &[ScalingRow], sweep: Sweep, (means, path, _): Line) -> Vec<&ScalingRow> {
    rows.iter().filter(|r| (r.sweep, r.means, r.path) == (sweep, means, path)).collect()
}

fn fits(rows: &[ScalingRow]) -> Vec<Fit> {
    let fit = |sweep, of: Line| {
        let sizes: Vec<_> =
            line(rows, sweep, of).into_iter().map(|r| (r.position(), r.ms)).collect();
        Fit { sweep, means: of.0, path: of.1, exponent: exponent(&sizes) }
    };
    SWEEPS.into_iter().flat_map(|sweep| LINES.map(|line| fit(sweep, line))).collect()
}

/// Returns the slope of the least-squares line through the logarithms, or `None` if it is undefined.
fn exponent(sizes: &[(f64, f64)]) -> Option<f64> {
    let logs: Vec<(f64, f64)> = sizes.iter().map(|(x, y)| (x.ln(), y.ln())).collect();
    let n = logs.len() as f64;
    let (mx, my) = logs.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x / n, b + y / n));
    let covariance: f64 = logs.iter().map(|(x, y)| (x - mx) * (y - my)).sum();
    let variance: f64 = logs.iter().map(|(x, _)| (x - mx).powi(2)).sum();
    let slope = covariance / variance;
    // A single size has no variance, and 0 / 0 is NaN.
    slope.is_finite().then_some(slope)
}

fn name(means: MeanPlacement, path: EnginePath) -> &'static str {
    LINES.iter().find(|line| (line.0, line.1) == (means, path)).map_or("", |line| line.2)
}

fn text(rows: &[ScalingRow]) -> String {
    table(
        rows,
        [
            ("means", |row| name(row.means, row.path).to_owned()),
            ("points", |row| row.points.to_string()),
            ("N", |row| row.components.to_string()),
            ("threads", |row| row.threads.to_string()),
            ("ms/frame [quartiles]", |row| row.spread().to_string()),
            ("plain / this", |row| format!("{:.1}", row.plain_over_this)),
        ],
    )
}

fn notes(plan: &ScalingPlan, rows: &[ScalingRow], fits: &[Fit]) -> Vec<String> {
    let mut notes = vec![format!(
        "C = 4, no reassignment, {} runs of {TIMED_FRAMES} timed frames each after one warm-up frame, in turns. Plain path: the plain engine in f64. Means on surfaces are points of six other frames.",
        plan.repeats
    )];
    for fit in fits {
        let Some(exponent) = fit.exponent else { continue };
        let name = name(fit.means, fit.path);
        notes.push(format!("{name}: ms grows as {}^{exponent:.2}", fit.sweep));
    }
    for of in LINES {
        let line = line(rows, Sweep::Threads, of);
        let ms = |threads| line.iter().find(|r| r.threads == threads).map(|r| r.ms);
        if let (Some(one), Some(two)) = (ms(1), ms(2)) {
            notes.push(format!("{}: two threads are {:.2} times as fast as one", of.2, one / two));
        }
    }
    notes
}

fn panels(rows: &[ScalingRow], fits: &[Fit]) -> Vec<Panel> {
    let series = |sweep, (of_line, fit): (Line, &Fit)| Series {
        name: match fit.exponent {
            Some(exponent) => format!("{}: ^{exponent:.2}", of_line.2),
            None => of_line.2.to_owned(),
        },
        marks: line(rows, sweep, of_line)
            .into_iter()
            .map(|r| Mark::new(Spread::exact(r.position()), r.spread()))
            .collect(),
        connected: true,
    };
    let panel = |(sweep, fits): (Sweep, &[Fit])| Panel {
        title: format!("against {sweep}"),
        x: Axis::Log(sweep.into()),
        y: Axis::Log("ms per frame"),
        series: LINES.into_iter().zip(fits).map(|of| series(sweep, of)).collect(),
    };
    // `fits` lists all lines of one sweep before those of the next.
    SWEEPS.into_iter().zip(fits.chunks(LINES.len())).map(panel).collect()
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
