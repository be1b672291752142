//! Other programs beside ours on the same frames. They take turns frame by frame, so that whatever else
//! the machine does slows all of them alike, and every time is told as a ratio to ours on that frame.

mod process;
mod shared_frames;

pub use process::{PeerCommand, PeerError};

use super::findings::{Bench, BenchError, BenchOptions, Findings, Progress};
use super::plot::axis::Axis;
use super::plot::draw::{self, Mark, Panel, Series};
use crate::dataset::Dataset;
use crate::eval::spread::Spread;
use crate::eval::table;
use crate::math::normalization::Normalization;
use crate::train::paper::config::{PaperConfig, PaperOverrides, ReassignPolicy};
use crate::train::paper::engine;
use crate::train::paper::init::InitialDraw;
use crate::train::paper::learner::PaperLearner;
use process::PeerProcess;
use serde::Serialize;
use serde_json::json;
use shared_frames::SharedFrames;
use std::sync::Arc;

/// Frames of a run, the first of which warms up, and the same of a quick one.
const FRAMES: usize = 11;
const QUICK_FRAMES: usize = 4;

/// What is measured.
#[derive(Clone, Debug)]
pub struct PeersPlan {
    /// Programs to compare with.
    pub peers: Vec<PeerCommand>,
    /// Components of every mixture.
    pub components: usize,
    /// What was asked for.
    pub options: BenchOptions,
}

/// One program.
#[derive(Clone, Debug, Serialize)]
pub struct PeerRow {
    /// Its name.
    pub name: String,
    /// Frames that count.
    pub frames: usize,
    /// Median milliseconds of learning a frame.
    pub ms: f64,
    /// A quarter of the frames took less.
    pub ms_q1: f64,
    /// A quarter took more.
    pub ms_q3: f64,
    /// Median of its time over ours on the same frame, without reassignment.
    pub ratio: f64,
    /// A quarter of these are less.
    pub ratio_q1: f64,
    /// A quarter are more.
    pub ratio_q3: f64,
}

/// Who learns frames in turns.
enum Learning {
    Ours(Box<dyn PaperLearner>),
    Theirs(PeerProcess),
}

/// Times every program on every frame.
pub fn run(
    plan: &PeersPlan,
    dataset: &Arc<Dataset>,
    progress: Progress,
) -> Result<Bench, BenchError> {
    let n = if plan.options.quick { QUICK_FRAMES } else { FRAMES };
    let n = plan.options.max_frames.unwrap_or(n).max(2);
    let config = |reassign| {
        PaperConfig::paper().with(&PaperOverrides {
            components: Some(plan.components),
            seed: Some(plan.options.seed),
            reassign: Some(reassign),
            ..PaperOverrides::default()
        })
    };
    let told = json!({ "components": plan.components, "threads": rayon::current_num_threads() });
    let frames = SharedFrames::write(dataset, n, &config(ReassignPolicy::Off)?, told)?;
    let draw = InitialDraw::random(plan.components, plan.options.seed);
    let mut lines = Vec::new();
    for (name, policy) in
        [("vbgs-studio", ReassignPolicy::Off), ("vbgs-studio, padded", ReassignPolicy::Padded)]
    {
        let engine = engine::begin(&config(policy)?, &draw, Normalization::IDENTITY)?;
        lines.push((name.to_owned(), Learning::Ours(engine)));
    }
    for peer in &plan.peers {
        let process = PeerProcess::start(peer, frames.folder.path())?;
        lines.push((peer.name.clone(), Learning::Theirs(process)));
    }
    let mut times = vec![Vec::new(); lines.len()];
    for (number, points) in frames.points.iter().enumerate() {
        for ((_, learning), times) in lines.iter_mut().zip(&mut times) {
            times.push(match learning {
                Learning::Ours(engine) => engine.learn(points)?.ms.train,
                Learning::Theirs(process) => process.learn(number)?,
            });
        }
        progress(number + 1, frames.points.len());
    }
    let names = lines.into_iter().map(|(name, _)| name);
    let rows: Vec<PeerRow> =
        names.zip(&times).map(|(name, own)| row(name, own, &times[0])).collect();
    findings(plan, &dataset.name, rows)
}

/// The row of a program's times beside ours, frame by frame.
fn row(name: String, own: &[f64], ours: &[f64]) -> PeerRow {
    // The first frame warms up, unless it is the only usable one.
    let counted = usize::from(own.len() > 1)..;
    let (own, ours) = (&own[counted.clone()], &ours[counted]);
    let ms = Spread::of(own.to_vec());
    let ratio = Spread::of(own.iter().zip(ours).map(|(own, ours)| own / ours).collect());
    let ([ms_q1, ms_q3], [ratio_q1, ratio_q3]) = (ms.quartiles, ratio.quartiles);
    let (ms, ratio) = (ms.median, ratio.median);
    PeerRow { name, frames: own.len(), ms, ms_q1, ms_q3, ratio, ratio_q1, ratio_q3 }
}

fn findings(plan: &PeersPlan, dataset: &str, rows: Vec<PeerRow>) -> Result<Bench, BenchError> {
    let notes = vec![format!(
        "{} components in every mixture; ms: median over frames of learning one from memory, the first left out; ratio: median of the time over vbgs-studio's on the same frame, without reassignment; quartiles beside both. Each program's own threads.",
        plan.components
    )];
    Findings {
        name: "peers",
        dataset,
        adapter: None,
        options: plan.options,
        notes,
        table: text(&rows),
        plot: draw::draw("The same frames by other programs", &[panel(&rows)])?,
        summary: json!({ "components": plan.components }),
        rows,
    }
    .into_bench()
}

fn text(rows: &[PeerRow]) -> String {
    let cells = |row: &PeerRow| {
        [
            row.name.clone(),
            row.frames.to_string(),
            format!("{:.2} ({:.2} to {:.2})", row.ms, row.ms_q1, row.ms_q3),
            format!("{:.2} ({:.2} to {:.2})", row.ratio, row.ratio_q1, row.ratio_q3),
        ]
    };
    let rows: Vec<_> = rows.iter().map(cells).collect();
    table::text(["program", "frames", "ms/frame", "ratio"], &rows)
}

fn panel(rows: &[PeerRow]) -> Panel {
    let mark = |(at, row): (usize, &PeerRow)| {
        let x = Spread { median: row.ratio, quartiles: [row.ratio_q1, row.ratio_q3] };
        Mark { x, y: Spread::exact(at as f64), label: None }
    };
    let marks = rows.iter().enumerate().map(mark).collect();
    Panel {
        title: "time a frame, ours without reassignment = 1".to_owned(),
        x: Axis::Log("times as long".to_owned()),
        y: Axis::Names(rows.iter().map(|row| row.name.clone()).collect()),
        series: vec![Series { name: "ratio".to_owned(), marks, connected: false }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ratios_are_of_the_same_frame_and_the_first_does_not_count() {
        let ours = [50.0, 2.0, 4.0, 8.0];
        let found = row("a".to_owned(), &[900.0, 6.0, 12.0, 24.0], &ours);
        assert_eq!((found.frames, found.ms, found.ratio), (3, 12.0, 3.0));
        assert_eq!((found.ratio_q1, found.ratio_q3), (3.0, 3.0));
        assert_eq!(row("b".to_owned(), &[4.0], &[2.0]).ratio, 2.0);
    }
}
