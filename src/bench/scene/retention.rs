//! Retention of earlier frames (`pipeline.md`, Retention bench): PSNR of each frame's own view
//! right after training on it and at the end, and PSNR of held-out views during training.
//!
//! A model that forgets renders its last frames well and its first ones badly. One configuration omits
//! the accumulated precision, which otherwise holds splats where earlier frames placed them.

use super::training::prepare;
use crate::bench::findings::{Bench, BenchError, BenchOptions, Findings, Progress, table};
use crate::bench::plot::{self, Axis, Mark, Panel, Series};
use crate::bench::{ViewIndices, each_frame, held_out_views, spaced};
use crate::dataset::Dataset;
use crate::eval::metrics::mean_std;
use crate::eval::views::{EvalOptions, evaluate};
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::plan::Plan;
use crate::pipeline::settings::scene::SceneRun;
use crate::train::learner::{Learner, Learns};
use crate::train::scene::photometric::rule::{PhotometricMode, PhotometricRule};
use crate::train::scene::trainer::SceneTrainer;
use serde::Serialize;
use std::sync::Arc;

const FRAMES: usize = 50;
/// Number of evaluations of the held-out views during training, and number of held-out views.
const LOOKS: [usize; 2] = [10, 10];

#[derive(Clone, Debug, Serialize)]
pub struct RetentionRow {
    pub configuration: &'static str,
    pub after_frames: usize,
    pub frame: String,
    /// PSNR right after training on the frame, dB.
    pub after: f64,
    pub at_end: f64,
}

#[derive(Clone, Debug, Serialize)]
pub struct RetentionSummary {
    pub configuration: &'static str,
    /// Mean PSNR of the frames' views, each right after training on its frame, dB.
    pub after: f64,
    /// Mean PSNR of the frames' views after training on all frames, dB.
    pub at_end: f64,
    /// Largest loss of PSNR of a frame's view from right after training on the frame to the end, dB.
    pub most_lost: f64,
    /// PSNR of the held-out views during training: number of frames trained on, and mean PSNR in dB.
    pub held_out: Vec<(usize, f64)>,
    /// Largest drop of the held-out views' PSNR below an earlier value, dB.
    pub held_out_fall: f64,
}

fn configurations() -> [(&'static str, Option<PhotometricRule>); 4] {
    let full = PhotometricRule::DEFAULT;
    [
        ("points alone", None),
        ("light", PhotometricMode::Light.rule()),
        ("full", PhotometricMode::Full.rule()),
        // Each frame uses the prior's precision only.
        (
            "full, no accumulated precision",
            Some(PhotometricRule { forgotten: 1.0, kept: 0.0, ..full }),
        ),
    ]
}

pub fn run(
    options: BenchOptions,
    dataset: Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let (most, looked_at) = if options.quick { (12, 6) } else { (usize::MAX, FRAMES) };
    let most = options.max_frames.unwrap_or(most);
    let (plan, base, views) = prepare(&dataset, most, options.seed)?;
    let positions: Vec<usize> = (0..plan.frames.len()).collect();
    let bench = Retention {
        held_out: held_out_views(&dataset, plan.split, LOOKS[1]),
        looked_at: spaced(&positions, looked_at),
        dataset,
        plan,
        views,
    };
    let (mut rows, mut summary) = (Vec::new(), Vec::new());
    for (done, (name, rule)) in configurations().into_iter().enumerate() {
        progress(done, configurations().len());
        let mut run = base.clone();
        run.engine.photometric = rule;
        let (found, kept) = bench.of(name, &run)?;
        rows.extend(found);
        summary.push(kept);
    }
    bench.into_bench(options, rows, summary)
}

struct Retention {
    dataset: Arc<Dataset>,
    plan: Plan,
    /// Positions in the plan of the frames whose views are measured.
    looked_at: Vec<usize>,
    held_out: ViewIndices,
    views: EvalOptions,
}

impl Retention {
    fn of(
        &self,
        configuration: &'static str,
        run: &SceneRun,
    ) -> Result<(Vec<RetentionRow>, RetentionSummary), BenchError> {
        let surface = run.prepared_surface();
        let mut scene = SceneTrainer::new(&run.engine, surface.origin);
        let (mut rows, mut held_out) = (Vec::new(), Vec::new());
        let n_frames = self.plan.frames.len();
        // Rounded up, so that there are at most as many evaluations as planned.
        let every = n_frames.div_ceil(LOOKS[0]).max(1);
        each_frame(&self.dataset, &self.plan, surface, |position, frame, prepared| {
            scene.learn(&prepared.observation)?;
            let after_frames = position + 1;
            if self.looked_at.contains(&position) {
                scene.settle();
                let after = self.psnr(&scene.splats(), self.own(position))?;
                // `at_end` is known only after the last frame.
                let row = RetentionRow { configuration, after_frames, frame, after, at_end: 0.0 };
                rows.push(row);
            }
            if after_frames.is_multiple_of(every) || after_frames == n_frames {
                scene.settle();
                let views = (self.held_out.0, self.held_out.1.as_slice());
                held_out.push((after_frames, self.psnr(&scene.splats(), views)?));
            }
            Ok(())
        })?;
        if rows.is_empty() {
            let first = "none of the frames whose own views are measured".to_owned();
            return Err(BenchError::NoFrame { dataset: self.dataset.name.clone(), first });
        }
        let splats = scene.splats();
        for row in &mut rows {
            // `after_frames` counts from 1, positions count from 0.
            row.at_end = self.psnr(&splats, self.own(row.after_frames - 1))?;
        }
        let summary = summarise(configuration, &rows, held_out);
        Ok((rows, summary))
    }

    fn own(&self, position: usize) -> (usize, &[usize]) {
        (self.plan.split, &self.plan.frames[position..=position])
    }

    fn psnr(
        &self,
        splats: &SplatSet,
        (split, views): (usize, &[usize]),
    ) -> Result<f64, BenchError> {
        let found = evaluate(splats, &self.dataset, split, views, &self.views, |_| ())?;
        Ok(found.0.means.psnr_mean)
    }

    fn into_bench(
        self,
        options: BenchOptions,
        rows: Vec<RetentionRow>,
        summary: Vec<RetentionSummary>,
    ) -> Result<Bench, BenchError> {
        let title = format!("Retention: {}", self.dataset.name);
        let note = format!(
            "{} frames as listed; own views of {} frames, right after training and at the end; {} held-out views; projected renderer, black background, recorded poses.",
            self.plan.frames.len(),
            self.looked_at.len(),
            self.held_out.1.len()
        );
        Findings {
            name: "retention",
            dataset: &self.dataset.name,
            adapter: None,
            options,
            notes: vec![note],
            table: text(&summary),
            plot: plot::draw(&title, &panels(&rows, &summary))?,
            rows,
            summary,
        }
        .into_bench()
    }
}

fn summarise(
    configuration: &'static str,
    rows: &[RetentionRow],
    held_out: Vec<(usize, f64)>,
) -> RetentionSummary {
    let mean =
        |value: fn(&RetentionRow) -> f64| mean_std(&rows.iter().map(value).collect::<Vec<_>>()).0;
    let (mut best, mut held_out_fall) = (f64::NEG_INFINITY, 0.0f64);
    for (_, psnr) in &held_out {
        // Relative to the best value so far: a slow decline counts as a whole.
        best = best.max(*psnr);
        held_out_fall = held_out_fall.max(best - psnr);
    }
    RetentionSummary {
        configuration,
        after: mean(|row| row.after),
        at_end: mean(|row| row.at_end),
        // Negative if every view improves.
        most_lost: rows.iter().map(|row| row.after - row.at_end).fold(f64::NEG_INFINITY, f64::max),
        held_out,
        held_out_fall,
    }
}

fn text(summary: &[RetentionSummary]) -> String {
    table(
        summary,
        [
            ("configuration", |row| row.configuration.to_owned()),
            ("own view, after training, dB", |row| format!("{:.2}", row.after)),
            ("at the end, dB", |row| format!("{:.2}", row.at_end)),
            ("lost dB", |row| format!("{:.2}", row.after - row.at_end)),
            ("most lost dB", |row| format!("{:.2}", row.most_lost)),
            ("held-out dB", |row| {
                row.held_out.last().map_or_else(String::new, |(_, psnr)| format!("{psnr:.2}"))
            }),
            ("largest fall, held-out dB", |row| format!("{:.2}", row.held_out_fall)),
        ],
    )
}

/// Plots the PSNR loss of training views and the PSNR of held-out views over the number of trained
/// frames.
fn panels(rows: &[RetentionRow], summary: &[RetentionSummary]) -> [Panel; 2] {
    let mark = |x: usize, y: f64| Mark::exact(x as f64, y);
    let lost = |kept: &RetentionSummary| {
        let rows = rows.iter().filter(|row| row.configuration == kept.configuration);
        let marks = rows.map(|row| mark(row.after_frames, row.after - row.at_end)).collect();
        Series { name: kept.configuration.to_owned(), marks, connected: false }
    };
    let held_out = |kept: &RetentionSummary| {
        let marks = kept.held_out.iter().map(|&(learnt, psnr)| mark(learnt, psnr)).collect();
        Series { name: kept.configuration.to_owned(), marks, connected: true }
    };
    let panel = |title: &str, y, series: Vec<Series>| Panel {
        title: title.to_owned(),
        x: Axis::Linear("frames trained"),
        y: Axis::Linear(y),
        series,
    };
    [
        panel("own views", "PSNR lost by the end, dB", summary.iter().map(lost).collect()),
        panel("held-out views", "PSNR, dB", summary.iter().map(held_out).collect()),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_lost_is_counted_from_the_best() {
        let row = |after: f64, at_end: f64| RetentionRow {
            configuration: "a",
            after_frames: 1,
            frame: String::new(),
            after,
            at_end,
        };
        let held_out = vec![(1, 20.0), (2, 25.0), (3, 24.0), (4, 24.6)];
        let found = summarise("a", &[row(30.0, 29.0), row(32.0, 32.5)], held_out);
        assert_eq!((found.after, found.at_end, found.most_lost), (31.0, 30.75, 1.0));
        assert_eq!(found.held_out_fall, 1.0);
    }
}
