//! Ablation of the published algorithm: cost and benefit of each step from the dense E-step to
//! forwarded reassignment, on any dataset.
//!
//! Rows with a dense E-step would take minutes per frame, so they run on evenly spaced whole tiles.
//! Times that grow with the number of points are scaled up. The models of these rows saw fewer points,
//! so their PSNR is comparable only among these rows; a note states this.

use super::runs::{TimedRow, TimedStep, time};
use super::sample::{TrainingSample, count};
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::eval::metrics::Spread;
use crate::observation::points::Points;
use crate::train::paper::config::{
    Candidates, PaperConfig, PaperOverrides, Precision, ReassignPolicy,
};
use crate::train::paper::init::InitialDraw;
use std::sync::Arc;

/// Sizes of the ablation. `frames` and `views` are maxima.
#[derive(Clone, Debug)]
pub struct AblationPlan {
    pub components: usize,
    pub frames: usize,
    pub views: usize,
    pub repeats: usize,
    /// Maximum number of point-component pairs that a row with a dense E-step scores per frame. The
    /// row's frames are thinned accordingly.
    pub dense_pairs: usize,
    pub options: BenchOptions,
}

impl AblationPlan {
    /// Creates a plan with the paper's number of components on up to 200 frames. Quick: a fifth of the
    /// components on 12 frames.
    pub fn new(options: BenchOptions) -> Self {
        let (components, frames, views, dense_pairs) = if options.quick {
            (20_000, 12, 4, 10_000_000)
        } else {
            (100_000, 200, 25, 20_000_000)
        };
        Self {
            components,
            frames: options.max_frames.unwrap_or(frames),
            views,
            repeats: options.repeats.unwrap_or(3),
            dense_pairs,
            options,
        }
    }

    fn steps(&self) -> Result<Vec<TimedStep>, BenchError> {
        let fused = PaperOverrides {
            components: Some(self.components),
            seed: Some(self.options.seed),
            reassign: Some(ReassignPolicy::Off),
            ..PaperOverrides::default()
        };
        // Precision f64 selects the plain engine.
        let plain = PaperOverrides { precision: Some(Precision::F64), ..fused.clone() };
        let dense = PaperOverrides { candidates: Some(Candidates::Dense), ..plain.clone() };
        let moving = |policy| PaperOverrides { reassign: Some(policy), ..fused.clone() };
        let steps = [
            ("dense E-step, plain engine in f64", dense, true),
            // The thinned points again, so that only the candidates differ from the row above.
            ("+ truncated E-step, C = 4, same points", plain.clone(), true),
            ("  truncated, all points", plain, false),
            ("+ fused kernels, mixed precision", fused.clone(), false),
            ("+ reassignment, dense", moving(ReassignPolicy::Dense), true),
            ("+ reassignment, padded", moving(ReassignPolicy::Padded), false),
            ("+ reassignment, forwarded", moving(ReassignPolicy::Forwarded), false),
        ];
        // One draw for all rows, so that they differ only in the measured step.
        let draw = InitialDraw::random(self.components, self.options.seed);
        let step = |(name, overrides, is_thinned): (&str, PaperOverrides, bool)| {
            Ok(TimedStep {
                sweep: "step",
                name: name.to_owned(),
                config: PaperConfig::paper().with(&overrides)?,
                threads: rayon::current_num_threads(),
                draw: draw.clone(),
                is_thinned,
            })
        };
        steps.into_iter().map(step).collect()
    }
}

pub fn run(
    plan: &AblationPlan,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let sample = TrainingSample::load(dataset, plan.frames, plan.views)?;
    // A dense row scores every point with every component.
    let thinned = sample.thinned(plan.dense_pairs / plan.components);
    let steps = plan.steps()?;
    // Errors against the oracle belong to `bench pareto`.
    let rows = time(&steps, &sample, &thinned, plan.repeats, progress, |_, _| Ok(None))?;
    let title = format!("Ablation: {}, N = {}", sample.dataset.name, plan.components);
    Findings {
        name: "ablation",
        dataset: &sample.dataset.name,
        adapter: None,
        options: plan.options,
        notes: notes(plan, &sample, &thinned),
        table: text(&rows),
        plot: plot::draw(&title, &panels(&rows))?,
        rows,
        summary: (),
    }
    .into_bench()
}

fn text(rows: &[TimedRow]) -> String {
    table(
        rows,
        [
            ("configuration", |row| row.configuration.clone()),
            ("points run", |row| format!("{:.1} %", 100.0 * row.points_share)),
            ("ms/frame [quartiles]", |row| row.spread().to_string()),
            ("PSNR dB", |row| format!("{:.2}", row.psnr)),
            ("used", |row| row.used.to_string()),
        ],
    )
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

fn panels(rows: &[TimedRow]) -> [Panel; 2] {
    let panel = |title: &str, x: Axis, names, of: &dyn Fn(&TimedRow) -> (Spread, String)| {
        let series = |name: &str, is_scaled: bool| {
            // Scaled times have their own colour, because they were not measured at full size.
            let of_kind =
                rows.iter().enumerate().filter(|(_, r)| (r.points_share < 1.0) == is_scaled);
            let mark = |(i, row): (usize, &TimedRow)| {
                let (x, label) = of(row);
                Mark { x, y: Spread::exact(i as f64), label: Some(label) }
            };
            Series { name: name.to_owned(), marks: of_kind.map(mark).collect(), connected: false }
        };
        let series = vec![series("all points", false), series("fewer points, time scaled", true)];
        Panel { title: title.to_owned(), x, y: Axis::Names(names), series }
    };
    let names = rows.iter().map(|r| r.configuration.trim().to_owned()).collect();
    // Both panels have the same rows. Repeating the names would leave no room for the marks.
    let blank = vec![String::new(); rows.len()];
    let (ms, psnr) = (Axis::Log("ms per frame (median, quartiles)"), Axis::Linear("PSNR, dB"));
    [
        panel("time", ms, names, &|row| (row.spread(), row.spread().to_string())),
        panel("quality", psnr, blank, &|row| (Spread::exact(row.psnr), format!("{:.2}", row.psnr))),
    ]
}
