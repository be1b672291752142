//! The paper's ablation: what each step from the dense E-step to forwarded reassignment costs and
//! brings, on any dataset.
//!
//! Rows are timed in turns, since a shared machine drifts by more than neighbouring rows differ.
//! Dense rows would take minutes a frame: they run on whole tiles, evenly spaced, and what grows
//! with the points is scaled back. Their models saw fewer points, so their PSNR compares within
//! those rows only; the table says so.

use super::runs;
use super::runs::{Runs, TimedConfiguration};
use super::sample::{TrainingSample, count};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::draw::{Mark, Panel, Series};
use crate::bench::plot::{Axis, draw};
use crate::dataset::Dataset;
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Batch, Candidates, IndexKind, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
    StatisticsForm,
};
use crate::train::paper::init::InitialDraw;
use crate::train::timing::{PaperStage, StageMs};
use serde::Serialize;
use std::sync::Arc;

/// Batch of the dense rows, as the reference scores them: what is written out must fit in memory.
const DENSE_BATCH: Batch = Batch::Points(128);

/// How much of the ablation is run.
#[derive(Clone, Debug)]
pub struct AblationPlan {
    /// Components of every row, the paper's N.
    pub components: usize,
    /// Training frames at most.
    pub frames: usize,
    /// Held-out views at most.
    pub views: usize,
    /// Runs of every row.
    pub repeats: usize,
    /// Pairs of a point and a component that a dense row may score per frame; frames are thinned
    /// to fit.
    pub dense_pairs: usize,
    /// Batches of the truncated row.
    pub batches: Vec<Batch>,
    /// What was asked for.
    pub options: BenchOptions,
}

impl AblationPlan {
    /// The paper's N on up to 200 frames, or a fifth of it on a dozen.
    pub fn new(options: BenchOptions) -> Self {
        let (components, frames, views, repeats, dense_pairs) = if options.quick {
            (20_000, 12, 4, 3, 10_000_000)
        } else {
            (100_000, 200, 25, 3, 20_000_000)
        };
        Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            views,
            repeats: options.repeats.unwrap_or(repeats),
            dense_pairs,
            batches: vec![
                Batch::Points(1024),
                Batch::Points(16_384),
                Batch::Points(65_536),
                Batch::Frame,
            ],
            options,
        }
    }
}

/// One row of the table.
#[derive(Clone, Debug, Serialize)]
pub struct AblationRow {
    /// What was changed.
    pub configuration: String,
    /// Points that pass through at once.
    pub batch: Batch,
    /// Share of the points that was really run; times are scaled to all of them.
    pub points_share: f64,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First quartile over the runs.
    pub ms_q1: f64,
    /// Third quartile over the runs.
    pub ms_q3: f64,
    /// Candidate search, scaled like `ms`.
    pub candidates_ms: f64,
    /// Scores and responsibilities, scaled like `ms`.
    pub e_step_ms: f64,
    /// Sums per tile, scaled like `ms`.
    pub stats_ms: f64,
    /// Addition to the totals.
    pub update_ms: f64,
    /// Choosing and moving components.
    pub reassign_ms: f64,
    /// Mean PSNR of the projected renderer, dB, after the points that were really run.
    pub psnr: f64,
    /// Components with statistics at the end.
    pub used: usize,
}

/// A configuration by its name in the table.
struct AblationStep {
    name: String,
    config: PaperConfig,
    is_thinned: bool,
}

/// Runs the ablation.
pub fn run(
    plan: &AblationPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let sample = TrainingSample::load(dataset, plan.frames, plan.views)?;
    let thinned = sample.thinned(plan.dense_pairs / plan.components);
    let rows = rows(plan)?;
    let frames =
        |row: &AblationStep| if row.is_thinned { &thinned[..] } else { &sample.frames[..] };
    let threads = rayon::current_num_threads();
    // One for all rows: they start alike and differ by what is measured only.
    let draw = InitialDraw::random(plan.components, plan.options.seed);
    let variant = |row: &AblationStep| TimedConfiguration {
        config: row.config.clone(),
        threads,
        draw: &draw,
        frames: frames(row),
    };
    let variants: Vec<TimedConfiguration> = rows.iter().map(variant).collect();
    let (mut done, steps) = (0, plan.repeats.max(1) * rows.len());
    let timed = runs::in_turns(&variants, plan.repeats, &mut || {
        done += 1;
        progress(done, steps);
    })?;
    let mut found = Vec::with_capacity(rows.len());
    for (row, runs) in rows.iter().zip(&timed) {
        found.push(measured(row, runs, &sample, frames(row))?);
    }
    let title = format!("Ablation: {}, N = {}", sample.dataset.name, plan.components);
    Findings {
        name: "ablation",
        dataset: &sample.dataset.name,
        adapter: None,
        options: plan.options,
        notes: notes(plan, &sample, &thinned),
        table: text(&found),
        plot: draw::draw(&title, &panels(&found))?,
        rows: found,
        summary: (),
    }
    .into_bench()
}

fn rows(plan: &AblationPlan) -> Result<Vec<AblationStep>, BenchError> {
    let plain = PaperOverrides {
        components: Some(plan.components),
        seed: Some(plan.options.seed),
        candidates: Some(Candidates::Dense),
        batch: Some(DENSE_BATCH),
        statistics: Some(StatisticsForm::Unfused),
        precision: Some(Precision::F64),
        reassign: Some(ReassignPolicy::Off),
        ..PaperOverrides::default()
    };
    let fused = PaperOverrides { statistics: Some(StatisticsForm::Fused), ..plain };
    // The tree stays until the grid has a row of its own: what truncation brings must not be mixed
    // with a faster index.
    let truncated = PaperOverrides {
        candidates: Some(PaperConfig::paper().candidates),
        index: Some(IndexKind::KdTree),
        ..fused
    };
    let whole = PaperOverrides { batch: Some(Batch::Frame), ..truncated };
    let fast =
        PaperOverrides { index: Some(IndexKind::Grid), precision: Some(Precision::Mixed), ..whole };
    let moving = |policy| PaperOverrides { reassign: Some(policy), ..fast };
    let mut rows = vec![
        ("dense E-step, statistics unfused, f64".to_owned(), plain, true),
        ("+ fused statistics".to_owned(), fused, true),
        // On the thinned points once more: against the row above nothing but the candidates
        // differs.
        ("+ truncated E-step, C = 4, same points".to_owned(), truncated.clone(), true),
    ];
    for &batch in &plan.batches {
        let name = format!("  truncated, all points, batch {}", batch_name(batch));
        rows.push((name, PaperOverrides { batch: Some(batch), ..truncated }, false));
    }
    rows.extend([
        ("+ grid index, mixed precision".to_owned(), fast.clone(), false),
        ("+ reassignment, dense".to_owned(), moving(ReassignPolicy::Dense), true),
        ("+ reassignment, truncated".to_owned(), moving(ReassignPolicy::Truncated), false),
        ("+ reassignment, padded".to_owned(), moving(ReassignPolicy::Padded), false),
        ("+ reassignment, forwarded".to_owned(), moving(ReassignPolicy::Forwarded), false),
    ]);
    let checked = rows.into_iter().map(|(name, overrides, is_thinned)| {
        Ok(AblationStep { name, config: PaperConfig::paper().with(&overrides)?, is_thinned })
    });
    checked.collect()
}

/// `frame` or the number of points.
pub fn batch_name(batch: Batch) -> String {
    match batch {
        Batch::Frame => "frame".to_owned(),
        Batch::Points(n) => n.to_string(),
    }
}

fn measured(
    row: &AblationStep,
    runs: &Runs,
    sample: &TrainingSample,
    frames: &[Points<f32>],
) -> Result<AblationRow, BenchError> {
    let points_share = count(frames) as f64 / count(&sample.frames) as f64;
    // What is done per component does not grow with the points.
    let scaled = |ms: &StageMs| {
        let per_component =
            [PaperStage::Update, PaperStage::Reassign].map(|stage| ms.values()[stage as usize]);
        let per_component: f64 = per_component.iter().sum();
        (ms.train - per_component) / points_share + per_component
    };
    let ms = runs.spread(scaled);
    let [candidates, e_step, stats, update, reassign] = runs.stages();
    Ok(AblationRow {
        configuration: row.name.clone(),
        batch: row.config.batch,
        points_share,
        ms: ms.median,
        ms_q1: ms.quartiles[0],
        ms_q3: ms.quartiles[1],
        candidates_ms: candidates / points_share,
        e_step_ms: e_step / points_share,
        stats_ms: stats / points_share,
        update_ms: update,
        reassign_ms: reassign,
        psnr: sample.psnr(&*runs.engine, &row.config)?,
        used: runs.engine.used(),
    })
}

impl AblationRow {
    fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}

fn text(rows: &[AblationRow]) -> String {
    let cells = |row: &AblationRow| {
        [
            row.configuration.clone(),
            batch_name(row.batch),
            format!("{:.1} %", 100.0 * row.points_share),
            row.spread().to_string(),
            format!("{:.2}", row.psnr),
            row.used.to_string(),
        ]
    };
    let header =
        ["configuration", "batch", "points run", "ms/frame [quartiles]", "PSNR dB", "used"];
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

fn notes(plan: &AblationPlan, sample: &TrainingSample, thinned: &[Points<f32>]) -> Vec<String> {
    let n_frames = sample.frames.len();
    vec![
        format!(
            "{n_frames} frames of {} points on average, {} runs in turns; a run is the median over its frames without the first.",
            count(&sample.frames) / n_frames,
            plan.repeats
        ),
        format!(
            "Rows below 100 % ran on {} points a frame (whole tiles, evenly spaced); all but update and reassignment is scaled to all points, and their PSNR is that of a model which saw no others: compare it within those rows only.",
            count(thinned) / n_frames
        ),
        format!(
            "PSNR: projected renderer, black background, {} held-out views, RGB with alpha dropped, scale factor 1.",
            sample.n_views()
        ),
    ]
}

fn panels(rows: &[AblationRow]) -> [Panel; 2] {
    let names: Vec<String> = rows.iter().map(|r| r.configuration.trim().to_owned()).collect();
    let series = |name: &str,
                  is_scaled: bool,
                  x: &dyn Fn(&AblationRow) -> Spread,
                  label: &dyn Fn(&AblationRow) -> String| {
        let of_kind = rows.iter().enumerate().filter(|(_, r)| (r.points_share < 1.0) == is_scaled);
        let mark = |(i, row): (usize, &AblationRow)| Mark {
            x: x(row),
            y: Spread::exact(i as f64),
            label: Some(label(row)),
        };
        Series { name: name.to_owned(), marks: of_kind.map(mark).collect(), connected: false }
    };
    let panel = |title: &str,
                 x_axis,
                 names,
                 x: &dyn Fn(&AblationRow) -> Spread,
                 label: &dyn Fn(&AblationRow) -> String| Panel {
        title: title.to_owned(),
        x: x_axis,
        y: Axis::Names(names),
        series: vec![
            series("all points", false, x, label),
            series("fewer points, time scaled", true, x, label),
        ],
    };
    // Both panels have the same rows; naming them twice would leave no room for marks.
    let blank = vec![String::new(); rows.len()];
    [
        panel(
            "time",
            Axis::Log("ms per frame (median, quartiles)".to_owned()),
            names,
            &AblationRow::spread,
            &|row| row.spread().to_string(),
        ),
        panel(
            "quality",
            Axis::Linear("PSNR, dB".to_owned()),
            blank,
            &|row| Spread::exact(row.psnr),
            &|row| format!("{:.2}", row.psnr),
        ),
    ]
}
