//! Ablation of the published algorithm: cost and benefit of each step from the dense E-step to
//! forwarded reassignment, on any dataset.
//!
//! Configurations run in turns, because a shared machine drifts by more than neighbouring rows
//! differ. Dense rows would take minutes per frame, so they run on evenly spaced whole tiles. Times
//! that grow with the number of points are scaled up. These models saw fewer points, so their PSNR
//! is comparable only within those rows; a note states this.

use super::runs;
use super::runs::{Runs, TimedConfiguration};
use super::sample::{TrainingSample, count};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
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

/// Batch size of the dense rows, as in the reference. The scores of a batch are stored and must fit
/// in memory.
const DENSE_BATCH: Batch = Batch::Points(128);

/// Sizes of the ablation. `frames` and `views` are maxima.
#[derive(Clone, Debug)]
pub struct AblationPlan {
    pub components: usize,
    pub frames: usize,
    pub views: usize,
    pub repeats: usize,
    /// Maximum number of point-component pairs that a dense row scores per frame. Frames are
    /// thinned to fit.
    pub dense_pairs: usize,
    /// Batch sizes of the truncated rows.
    pub batches: Vec<Batch>,
    pub options: BenchOptions,
}

impl AblationPlan {
    /// Full size: the paper's N on up to 200 frames. Quick: a fifth of N on 12 frames.
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

/// One row of the table. Times are medians over the runs, in milliseconds per frame of all points.
#[derive(Clone, Debug, Serialize)]
pub struct AblationRow {
    pub configuration: String,
    /// Points processed at once.
    pub batch: Batch,
    /// Share of the points that were processed. Times are scaled to all points.
    pub points_share: f64,
    pub ms: f64,
    pub ms_q1: f64,
    pub ms_q3: f64,
    /// Candidate search.
    pub candidates_ms: f64,
    /// Scores and responsibilities.
    pub e_step_ms: f64,
    /// Sums per tile.
    pub stats_ms: f64,
    /// Adding the sums to the totals. Not scaled: independent of the number of points.
    pub update_ms: f64,
    /// Selecting and moving components. Not scaled: independent of the number of points.
    pub reassign_ms: f64,
    /// Mean PSNR in dB, projected renderer, of the model trained on the processed points.
    pub psnr: f64,
    /// Components with statistics after the last frame.
    pub used: usize,
}

struct AblationStep {
    name: String,
    config: PaperConfig,
    is_thinned: bool,
}

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
    // One draw for all rows, so that they differ only in the measured step.
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
        plot: plot::draw(&title, &panels(&found))?,
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
    // Keep the k-d tree until the grid has a row of its own, so that truncation is not mixed with a
    // faster index.
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
        // The thinned points again, so that only the candidates differ from the row above.
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

/// Formats a batch size: `frame` or the number of points.
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
    // Work per component does not grow with the number of points.
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
            "{n_frames} frames of {} points on average, {} runs in turns; the time of a run is the median over its frames without the first.",
            count(&sample.frames) / n_frames,
            plan.repeats
        ),
        format!(
            "Rows below 100 % ran on {} points per frame (evenly spaced whole tiles). Their times, except update and reassignment, are scaled to all points. Their models were trained on these points only: compare their PSNR within these rows only.",
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
    // Both panels have the same rows. Repeating the names would leave no room for the marks.
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
