//! Cost against points, components and threads, with the exponents that fit.

mod plan;
mod report;
mod room;
mod row;

pub use plan::ScalingPlan;
pub use row::{EnginePath, MeanPlacement, ScalingRow, Sweep};

use super::runs::{median, with_threads};
use super::sample::thin;
use crate::bench::findings::{Bench, BenchError, Findings, Progress};
use crate::bench::plot::draw;
use crate::eval::spread::Spread;
use crate::math::normalization::Normalization;
use crate::train::paper::config::{
    IndexKind, PaperConfig, PaperOverrides, Precision, ReassignPolicy, StatisticsForm,
};
use crate::train::paper::engine;
use crate::train::stages::PaperStage;
use crate::train::timing::StageMs;
use plan::ScalingPoint;
use report::{ScalingSummary, notes, panels, text};
use room::RoomFrames;
use row::LINES;

/// Times every combination on the synthetic room.
pub fn run(plan: &ScalingPlan, progress: Progress) -> Result<Bench, BenchError> {
    let stops = plan.stops();
    let largest = stops.iter().map(|s| s.points).max().unwrap_or(1);
    // Rendered once for the largest: the others thin the same frame, so that only size differs.
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
        // Made inside the pool: an engine keeps memory for each of its threads.
        let mut engines = Vec::new();
        for (means, path) in LINES {
            let config = config(path, stop.components, plan.options.seed)?;
            let draw = room.draw(means, stop.components, plan.options.seed);
            let mut engine = engine::begin(&config, &draw, Normalization::IDENTITY)?;
            engine.learn(&frame)?;
            engines.push(engine);
        }
        let mut times: [Vec<StageMs>; LINES.len()] = Default::default();
        // The same frame again and again is as much work each time: without reassignment the E-step
        // reads a model that never changes (`model.md`, Three models).
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
