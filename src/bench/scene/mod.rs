//! Contribution of each part of the scene preset (`pipeline.md`, Accuracy bench), and quality
//! against number of components, on any dataset.
//!
//! The first two tables measure each part in two ways. The first adds parts one by one, so a part is
//! measured without the parts after it. The second leaves out one part at a time, so a part is measured
//! with all others. The difference shows parts that help only in combination. Creation of components
//! and refinement depend on the order of frames, so a difference counts only if it exceeds the spread
//! over three orders. All rows are evaluated with one camera, regardless of the camera they were
//! trained with.

mod report;
pub mod retention;
pub(super) mod training;
mod variants;
pub mod views;

use super::findings::{Bench, BenchError, BenchOptions, Findings, Progress, steps};
use super::plot;
use super::{ViewIndices, held_out_views, spaced};
use crate::dataset::Dataset;
use crate::eval::choices::SEEN_AFTER;
use crate::eval::cracks::CrackReport;
use crate::eval::metrics::{Spread, mean_std};
use crate::eval::report::{EvalReport, SeenReport};
use crate::eval::views::EvalOptions;
use crate::eval::{choices, cracks};
use crate::pipeline::error::SessionError;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::scene::photometric::rule::PhotometricMode;
use serde::Serialize;
use std::sync::Arc;
use training::{Trained, n_sweeps, ordered, prepare, train};
use variants::{SceneVariant, Table, budgets, parts, scales};

/// What the accuracy benchmark runs, which sets the number of rows in each of its tables. `frames` and
/// `views` are upper limits.
#[derive(Clone, Debug)]
pub struct AccuracyPlan {
    pub frames: usize,
    pub views: usize,
    /// Number of frame orders. The first is as listed, the second reversed, others shuffled.
    pub orders: usize,
    /// Structural scales of the rows, as factors of the preset's structural scale.
    pub scales: Vec<f64>,
    pub options: BenchOptions,
}

impl AccuracyPlan {
    /// Creates a plan with all frames and views in three orders. Quick: 12 frames and 4 views in two
    /// orders.
    pub fn new(options: BenchOptions) -> Self {
        let (frames, views, orders, scales) = if options.quick {
            (12, 4, 2, vec![1.0, 1.5])
        } else {
            (usize::MAX, usize::MAX, 3, vec![0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0])
        };
        Self {
            frames: options.max_frames.unwrap_or(frames),
            views,
            // `repeats` is the number of orders, because repeating one order gives identical bits.
            orders: options.repeats.unwrap_or(orders),
            scales,
            options,
        }
    }
}

struct AccuracyRuns {
    dataset: Arc<Dataset>,
    plan: Plan,
    /// Held-out views on which quality is measured.
    views: ViewIndices,
    crack_views: Option<ViewIndices>,
    options: EvalOptions,
}

pub fn run(
    plan: &AccuracyPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let (stage, base) = AccuracyRuns::new(plan, dataset)?;
    let mut rows = parts(&base);
    let of_scale = scales(&stage.dataset, &stage.plan, &base, &plan.scales);
    rows.extend(of_scale.map_err(SessionError::from)?);
    // Budgets are shares of the components born without a budget, which requires a run of its own.
    rows.extend(budgets(&base, stage.born(&base)?));
    // Train equal configurations only once.
    let mut runs: Vec<SceneRun> = Vec::new();
    for row in &rows {
        if !runs.contains(&row.run) {
            runs.push(row.run.clone());
        }
    }
    let n_orders = plan.orders.max(1);
    let mut step = steps(progress, n_orders * (n_sweeps(&runs) + runs.len()) + 1);
    let mut measured: Vec<Vec<Measured>> = runs.iter().map(|_| Vec::new()).collect();
    for order in 0..n_orders {
        let ordered = ordered(&stage.plan, order, plan.options.seed);
        let trained = train(&stage.dataset, &ordered, &runs, &mut step)?;
        for (trained, measured) in trained.into_iter().zip(&mut measured) {
            // Detect cracks in one order only: it costs two more renders per view.
            let quality = stage.quality(&trained, order == 0)?;
            measured.push(Measured { trained, quality });
            step();
        }
    }
    let seen = stage.seen(&base)?;
    step();
    let found: Vec<AccuracyRow> = rows
        .iter()
        .filter_map(|row| {
            // Never `None`: every row contributed its run.
            let at = runs.iter().position(|run| *run == row.run)?;
            Some(AccuracyRow::of(row, &measured[at]))
        })
        .collect();
    let summary = AccuracySummary {
        base,
        frames: stage.plan.frames.len(),
        views: stage.views.1.len(),
        orders: n_orders,
        seen,
    };
    stage.into_bench(plan, found, summary)
}

impl AccuracyRuns {
    fn new(plan: &AccuracyPlan, dataset: Arc<Dataset>) -> Result<(Self, SceneRun), BenchError> {
        let (training, base, options) = prepare(&dataset, plan.frames, plan.options.seed)?;
        let views = held_out_views(&dataset, training.split, plan.views);
        let crack_views = cracks::views(&dataset, views.0, &views.1);
        let crack_views = crack_views.map(|(split, frames)| (split, spaced(&frames, plan.views)));
        Ok((Self { dataset, plan: training, views, crack_views, options }, base))
    }

    /// Trains the preset on the frames as listed and returns the number of components created.
    fn born(&self, base: &SceneRun) -> Result<usize, BenchError> {
        let trained = train(&self.dataset, &self.plan, std::slice::from_ref(base), &mut || ())?;
        Ok(trained.first().map_or(0, |trained| trained.born))
    }

    fn quality(&self, trained: &Trained, with_cracks: bool) -> Result<EvalReport, BenchError> {
        let (dataset, splats) = (&self.dataset, trained.splats.view());
        let views = (self.views.0, self.views.1.as_slice());
        let crack_views = self.crack_views.as_ref().filter(|_| with_cracks);
        let crack_views = crack_views.map(|(split, frames)| (*split, frames.as_slice()));
        let options = &self.options;
        let measured =
            choices::measure_quality(splats, dataset, views, crack_views, options, |_| ())?;
        Ok(measured.0)
    }

    /// Measures quality on the pixels that depth cameras observed, after each number of trained frames
    /// in [`SEEN_AFTER`].
    fn seen(&self, base: &SceneRun) -> Result<Vec<SeenReport>, BenchError> {
        let mut found = Vec::new();
        // A shorter selection never reaches the later moments.
        for n_frames in SEEN_AFTER.into_iter().filter(|&n| n <= self.plan.frames.len()) {
            let frames = self.plan.frames[..n_frames].to_vec();
            let plan = Plan { frames, ..self.plan.clone() };
            // Train again: the runs of the tables do not retain intermediate models.
            for early in train(&self.dataset, &plan, std::slice::from_ref(base), &mut || ())? {
                let (dataset, splats) = (&self.dataset, early.splats.view());
                let frames = (plan.split, plan.frames.as_slice());
                found.extend(choices::seen(splats, dataset, frames, &self.options)?);
            }
        }
        Ok(found)
    }

    fn into_bench(
        self,
        plan: &AccuracyPlan,
        rows: Vec<AccuracyRow>,
        summary: AccuracySummary,
    ) -> Result<Bench, BenchError> {
        let title = format!("Accuracy: {}", self.dataset.name);
        let is_registered = self.options.color_camera.is_none();
        Findings {
            name: "accuracy",
            dataset: &self.dataset.name,
            adapter: None,
            options: plan.options,
            notes: report::notes(&summary, self.crack_views.as_ref().map_or(0, |v| v.1.len())),
            table: report::text(&rows),
            plot: plot::draw(&title, &report::panels(&rows, is_registered))?,
            rows,
            summary,
        }
        .into_bench()
    }
}

/// One row of a table. Quality values are means over views, then over the orders of frames.
#[derive(Clone, Debug, Serialize)]
pub struct AccuracyRow {
    pub table: Table,
    pub configuration: String,
    pub photographs: PhotometricMode,
    pub h: f64,
    pub drawn: f64,
    pub born: f64,
    pub bytes_per_component: f64,
    pub train_ms: f64,
    pub prepare_ms: f64,
    pub psnr: f64,
    pub psnr_low: f64,
    pub psnr_high: f64,
    pub psnr_covered: Option<f64>,
    pub psnr_aligned_covered: Option<f64>,
    pub coverage: f64,
    pub ssim: f64,
    pub ssim_aligned: Option<f64>,
    /// Fraction of interior pixels with transmittance > 0.1 at the training distance. This field and
    /// the next three are measured with the first order of frames only.
    pub cracks_01: Option<f64>,
    pub cracks_03: Option<f64>,
    pub cracks_half_01: Option<f64>,
    pub cracks_half_03: Option<f64>,
}

#[derive(Clone, Debug, Serialize)]
pub struct AccuracySummary {
    pub base: SceneRun,
    pub frames: usize,
    pub views: usize,
    pub orders: usize,
    /// Quality of the preset early in training, on pixels that depth cameras observed.
    pub seen: Vec<SeenReport>,
}

pub struct Measured {
    pub trained: Trained,
    pub quality: EvalReport,
}

impl AccuracyRow {
    pub fn of(variant: &SceneVariant, orders: &[Measured]) -> Self {
        let mean = |value: &dyn Fn(&Measured) -> f64| {
            mean_std(&orders.iter().map(value).collect::<Vec<_>>()).0
        };
        let mean_known = |value: &dyn Fn(&EvalReport) -> Option<f64>| {
            // `None` if any order has no value: means over different orders are not comparable.
            let values: Option<Vec<f64>> = orders.iter().map(|m| value(&m.quality)).collect();
            values.map(|values| mean_std(&values).0)
        };
        let psnr = || orders.iter().map(|m| m.quality.means.psnr_mean);
        let median = |times: &dyn Fn(&Trained) -> &[f64]| {
            Spread::of(orders.iter().flat_map(|m| times(&m.trained)).copied().collect()).median
        };
        let cracks: Option<&CrackReport> = orders.iter().find_map(|m| m.quality.cracks.as_ref());
        // No interior pixel may be visible from half the distance.
        let half = cracks.and_then(|c| c.half_distance);
        Self {
            table: variant.table,
            configuration: variant.name.clone(),
            photographs: PhotometricMode::of(variant.run.engine.photometric),
            h: variant.run.engine.h,
            drawn: mean(&|m| m.trained.drawn() as f64),
            born: mean(&|m| m.trained.born as f64),
            // A scene without components has no size per component.
            bytes_per_component: mean(&|m| {
                m.trained.model_bytes as f64 / m.trained.born.max(1) as f64
            }),
            train_ms: median(&|t| &t.train_ms),
            prepare_ms: median(&|t| &t.prepare_ms),
            psnr: mean(&|m| m.quality.means.psnr_mean),
            // Extremes rather than quartiles: three orders are too few for these.
            psnr_low: psnr().fold(f64::INFINITY, f64::min),
            psnr_high: psnr().fold(f64::NEG_INFINITY, f64::max),
            psnr_covered: mean_known(&|q| q.means.psnr_covered_mean),
            psnr_aligned_covered: mean_known(&|q| q.means.psnr_aligned_covered_mean),
            coverage: mean(&|m| m.quality.means.coverage_mean),
            ssim: mean(&|m| m.quality.means.ssim_mean),
            ssim_aligned: mean_known(&|q| q.means.ssim_aligned_mean),
            cracks_01: cracks.map(|c| c.training_distance.over_01),
            cracks_03: cracks.map(|c| c.training_distance.over_03),
            cracks_half_01: half.map(|c| c.over_01),
            cracks_half_03: half.map(|c| c.over_03),
        }
    }
}
