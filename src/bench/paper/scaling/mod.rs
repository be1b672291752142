//! Cost per frame against points, components and threads, with fitted exponents.

mod report;

use super::runs::{median, with_threads};
use super::sample::thin;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot;
use crate::dataset::error::FrameError;
use crate::dataset::synthetic::SyntheticParams;
use crate::dataset::unproject::{CameraConvention, EdgeFilter, UnprojectSettings, Unprojector};
use crate::dataset::{Dataset, range, synthetic};
use crate::eval::metrics::Spread;
use crate::math::measured_pixel::Normalization;
use crate::observation::points::Points;
use crate::pipeline::error::SessionError;
use crate::train::paper::config::{
    IndexKind, PaperConfig, PaperOverrides, Precision, ReassignPolicy, StatisticsForm,
};
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner;
use crate::train::timing::{PaperStage, StageMs};
use report::{ScalingSummary, notes, panels, text};
use serde::Serialize;

/// Times every combination on the synthetic room.
pub fn run(plan: &ScalingPlan, progress: Progress) -> Result<Bench, BenchError> {
    let stops = plan.stops();
    let largest = stops.iter().map(|s| s.points).max().unwrap_or(1);
    // Render once at the largest size. Smaller sizes thin the same frame, so that only the size
    // differs.
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
        plot: plot::draw("Cost per frame: synthetic room, C = 4", &panels(&rows, &summary.fits))?,
        rows,
        summary,
    }
    .into_bench()
}

/// Times the four [`LINES`] at one size in turns, after one warm-up frame.
fn time_stop(
    stop: &ScalingPoint,
    room: &RoomFrames,
    plan: &ScalingPlan,
) -> Result<Vec<ScalingRow>, BenchError> {
    let frame = thin(&room.frame, stop.points);
    let times = with_threads(stop.threads, || -> Result<_, BenchError> {
        // Inside the pool, because an engine allocates memory per thread.
        let mut engines = Vec::new();
        for (means, path) in LINES {
            let config = config(path, stop.components, plan.options.seed)?;
            let draw = room.draw(means, stop.components, plan.options.seed);
            let mut engine = learner::begin(&config, &draw, Normalization::IDENTITY)?;
            engine.learn(&frame)?;
            engines.push(engine);
        }
        let mut times: [Vec<StageMs>; LINES.len()] = Default::default();
        // Repeated training on the same frame costs the same each time: without reassignment the
        // E-step reads a model that never changes (`model.md`, Three models).
        for _ in 0..plan.repeats.max(1) {
            for (engine, times) in engines.iter_mut().zip(&mut times) {
                times.push(engine.learn(&frame)?.ms);
            }
        }
        Ok(times)
    })??;
    let total = |i: usize| Spread::of(times[i].iter().map(|ms| ms.train).collect());
    let row = |(i, &(means, path)): (usize, &(MeanPlacement, EnginePath))| {
        let ms = total(i);
        let stages = median(&times[i]);
        let stage_ms = |stage: PaperStage| stages.values()[stage as usize];
        // Plain lines follow the fast ones in the same order of means.
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
            candidates_ms: stage_ms(PaperStage::Candidates),
            e_step_ms: stage_ms(PaperStage::EStep),
            stats_ms: stage_ms(PaperStage::Stats),
            update_ms: stage_ms(PaperStage::Update),
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
        ..PaperOverrides::default()
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

/// Sizes to time.
#[derive(Clone, Debug)]
pub struct ScalingPlan {
    pub points: Vec<usize>,
    pub components: Vec<usize>,
    /// Values above the machine's number of threads are skipped.
    pub threads: Vec<usize>,
    /// Points per frame while another size is swept.
    pub base_points: usize,
    /// Components while another size is swept.
    pub base_components: usize,
    /// Timed frames per size.
    pub repeats: usize,
    pub options: BenchOptions,
}

impl ScalingPlan {
    /// Up to 2·10⁵ points and 10⁶ components (3·10⁵ if quick).
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

    /// All sizes to time.
    pub fn stops(&self) -> Vec<ScalingPoint> {
        let all = rayon::current_num_threads();
        let mut threads: Vec<usize> = self.threads.iter().copied().filter(|&t| t < all).collect();
        // No more threads than the machine has: that would measure its scheduler.
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

/// One size of a sweep.
pub struct ScalingPoint {
    pub sweep: Sweep,
    pub points: usize,
    pub components: usize,
    pub threads: usize,
}

/// A frame to train on, and points of other frames as initial means on surfaces.
pub struct RoomFrames {
    /// In model coordinates.
    pub frame: Points<f32>,
    others: Points<f32>,
}

/// Number of other frames that means are drawn from.
const OTHER_FRAMES: usize = 6;

impl RoomFrames {
    /// Renders frames of at least `n_points` points each.
    pub fn load(n_points: usize, seed: u64) -> Result<Self, BenchError> {
        // Depth is dropped at edges, so render a few more pixels than requested points.
        let height = (1.06 * n_points as f64 * 0.75).sqrt().ceil().max(8.0);
        let params = SyntheticParams {
            width: (height / 0.75).ceil() as u32,
            height: height as u32,
            n_train: OTHER_FRAMES + 1,
            n_eval: 0,
            seed,
            depth_noise: 0.0,
            ..SyntheticParams::demo()
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
            // Tiles are irrelevant here: means are drawn from single points.
            others.close_tile();
        }
        Ok(Self { frame, others })
    }

    /// Draws initial means of one kind.
    pub fn draw(&self, means: MeanPlacement, components: usize, seed: u64) -> InitialDraw {
        match means {
            MeanPlacement::Random => InitialDraw::random(components, seed),
            MeanPlacement::Surface => InitialDraw::from_points(&self.others, components, seed),
        }
    }
}

fn unprojected(dataset: &Dataset, index: usize) -> Result<Points<f32>, BenchError> {
    let range = range::estimate(dataset, 0).map_err(SessionError::from)?;
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

#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    Points,
    Components,
    Threads,
}

/// Placement of the initial means.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanPlacement {
    /// Random, as in the paper: most are far from every point.
    Random,
    /// On points of other frames, as after reassignment.
    Surface,
}

/// Implementation that processes a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnginePath {
    /// Grid, mixed precision, fused statistics.
    Fast,
    /// KD-tree, f64, unfused statistics.
    Plain,
}

/// Lines of the plot. Plain lines follow the fast ones in the same order of means.
pub const LINES: [(MeanPlacement, EnginePath); 4] = [
    (MeanPlacement::Random, EnginePath::Fast),
    (MeanPlacement::Surface, EnginePath::Fast),
    (MeanPlacement::Random, EnginePath::Plain),
    (MeanPlacement::Surface, EnginePath::Plain),
];

/// One timed combination. Times are medians per frame in milliseconds, with quartiles over the
/// frames.
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
    /// Candidate search.
    pub candidates_ms: f64,
    /// Scores and responsibilities.
    pub e_step_ms: f64,
    /// Sums per tile.
    pub stats_ms: f64,
    /// Adding the sums to the totals.
    pub update_ms: f64,
    /// Median time of the plain path with the same means, divided by the median of this row.
    pub plain_over_this: f64,
}

impl ScalingRow {
    /// Value of the swept size: the position on the x axis.
    pub fn position(&self) -> f64 {
        let size = match self.sweep {
            Sweep::Points => self.points,
            Sweep::Components => self.components,
            Sweep::Threads => self.threads,
        };
        size as f64
    }

    /// Median and quartiles, milliseconds per frame.
    pub fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}
