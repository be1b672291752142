//! What every part of the scene preset brings (`pipeline.md`, Accuracy bench), on any dataset, and
//! how many components buy which quality.
//!
//! The first two tables bracket every part: added one by one, a part is measured without those that
//! come after it; left out of the whole, with all of them. Parts that help only beside others show
//! in the difference. Orders of the frames are part of the measurement, since births and refinement
//! depend on them: the spread over three orders is what a difference must exceed. All rows are
//! judged by one camera, whatever they were trained with.

mod perturbed;
pub mod real;
mod report;
pub mod retention;
mod row;
mod training;
mod variants;

pub use row::{AccuracyRow, AccuracySummary};

use super::paper::sample::spaced;
use super::plot::draw;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use crate::dataset::Dataset;
use crate::eval::choices::GroundTruth;
use crate::eval::cracks;
use crate::eval::measure::{self, SEEN_AFTER};
use crate::eval::report::{EvalReport, SeenReport};
use crate::eval::views::EvalOptions;
use crate::pipeline::any_preset::AnyPreset;
use crate::pipeline::error::SessionError;
use crate::pipeline::plan::{Plan, Selection};
use crate::pipeline::settings::scene::{SceneOverrides, SceneRun};
use crate::render::{RenderMethod, RenderOptions};
use row::Measured;
use std::sync::Arc;
use training::{Trained, n_sweeps, ordered, train};
use variants::{budgets, constants, parts, scales};

/// How much of the tables is run.
#[derive(Clone, Debug)]
pub struct AccuracyPlan {
    /// Training frames at most.
    pub frames: usize,
    /// Held-out views at most.
    pub views: usize,
    /// Orders of the frames: as listed, reversed, then shuffles.
    pub orders: usize,
    /// Structural scales, in those of the preset.
    pub scales: Vec<f64>,
    /// What was asked for.
    pub options: BenchOptions,
}

impl AccuracyPlan {
    /// Every frame and view in three orders, or a dozen frames in two.
    pub fn new(options: BenchOptions) -> Self {
        let (frames, views, orders, scales) = if options.quick {
            (12, 4, 2, vec![1.0, 1.5])
        } else {
            (usize::MAX, usize::MAX, 3, vec![0.625, 0.75, 0.875, 1.0, 1.25, 1.5, 2.0])
        };
        Self {
            frames: options.max_frames.unwrap_or(frames),
            views,
            // Repeats are orders here: the same order again would give the same bits.
            orders: options.repeats.unwrap_or(orders),
            scales,
            options,
        }
    }
}

/// Everything that runs share.
struct AccuracyRuns {
    dataset: Arc<Dataset>,
    plan: Plan,
    /// Split and positions of the held-out views.
    views: (usize, Vec<usize>),
    /// Split and positions of the views that show cracks, where there are any.
    crack_views: Option<(usize, Vec<usize>)>,
    options: EvalOptions,
}

/// Runs the tables.
pub fn run(
    plan: &AccuracyPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let (stage, base) = AccuracyRuns::new(plan, dataset)?;
    let mut rows = parts(&base);
    if !plan.options.quick {
        rows.extend(constants(&base));
    }
    let of_scale = scales(&stage.dataset, &stage.plan, &base, &plan.scales);
    rows.extend(of_scale.map_err(SessionError::from)?);
    // Budgets are shares of what is born without one, which only a run of its own tells.
    rows.extend(budgets(&base, stage.born(&base)?));
    // Equal configurations are run once.
    let mut runs: Vec<SceneRun> = Vec::new();
    for row in &rows {
        if !runs.contains(&row.run) {
            runs.push(row.run.clone());
        }
    }
    let n_orders = plan.orders.max(1);
    let (mut done, steps) = (0, n_orders * (n_sweeps(&runs) + runs.len()) + 1);
    let mut step = || {
        done += 1;
        progress(done, steps);
    };
    let mut measured: Vec<Vec<Measured>> = runs.iter().map(|_| Vec::new()).collect();
    for order in 0..n_orders {
        let ordered = ordered(&stage.plan, order, plan.options.seed);
        let trained = train(&stage.dataset, &ordered, &runs, &mut step)?;
        for (trained, measured) in trained.into_iter().zip(&mut measured) {
            // Cracks are looked for in one order only: they cost two renders more a view.
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
        let everything = Selection::all_frames();
        let all =
            Plan::new(&dataset, &everything, plan.options.seed).map_err(SessionError::from)?;
        let held_out = dataset.evaluation(all.split).new_views;
        let training = Plan { frames: spaced(&all.frames, plan.frames), ..all };
        let base = SceneRun::new(&dataset, &training, &SceneOverrides::default());
        let base = base.map_err(SessionError::from)?;
        let views = spaced(&held_out.frames, plan.views);
        let crack_views = cracks::views(&dataset, held_out.split, &views);
        let crack_views = crack_views.map(|(split, frames)| (split, spaced(&frames, plan.views)));
        let render = RenderOptions::evaluation(RenderMethod::PROJECTED, [0.0; 3]);
        // All rows are judged by the same camera, whatever they were trained with.
        let color_camera = base.color_camera();
        let options =
            EvalOptions { color_camera, ..EvalOptions::plain(GroundTruth::Composited, render) };
        let views = (held_out.split, views);
        Ok((Self { dataset, plan: training, views, crack_views, options }, base))
    }

    /// Components that the preset makes of the frames as listed.
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
            measure::measure_quality(splats, dataset, views, crack_views, options, |_| ())?;
        Ok(measured.0)
    }

    /// Early looks at what was learnt, frames as listed.
    fn seen(&self, base: &SceneRun) -> Result<Vec<SeenReport>, BenchError> {
        let mut found = Vec::new();
        for n_frames in SEEN_AFTER.into_iter().filter(|&n| n <= self.plan.frames.len()) {
            let frames = self.plan.frames[..n_frames].to_vec();
            let plan = Plan { frames, ..self.plan.clone() };
            // Trained anew: the runs of the tables leave nothing behind of what they were midway.
            for early in train(&self.dataset, &plan, std::slice::from_ref(base), &mut || ())? {
                let (dataset, splats) = (&self.dataset, early.splats.view());
                let frames = (plan.split, plan.frames.as_slice());
                found.extend(measure::seen(splats, dataset, frames, &self.options)?);
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
            plot: draw::draw(&title, &report::panels(&rows, is_registered))?,
            rows,
            summary,
        }
        .into_bench()
    }
}
