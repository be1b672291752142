//! Rows, table, notes and plot of frame times.

use super::painter::{FramePath, STAGES};
use super::{RENDERERS, RenderPlan};
use crate::bench::findings::table;
use crate::bench::plot::{Axis, Mark, Panel, Series};
use crate::eval::metrics::Spread;
use crate::render::Renderer;
use serde::Serialize;

/// One timed combination of device, renderer, number of splats and image size. Times are medians per
/// frame in milliseconds, with quartiles. They are `None` if nothing was drawn or a stage is not timed
/// separately.
#[derive(Clone, Debug, Serialize)]
pub struct RenderRow {
    pub path: FramePath,
    pub renderer: Renderer,
    pub splats: usize,
    pub width: u32,
    pub height: u32,
    /// Number of timed frames; 0 if nothing was drawn.
    pub frames: usize,
    pub ms: Option<f64>,
    pub ms_q1: Option<f64>,
    pub ms_q3: Option<f64>,
    pub prepare_ms: Option<f64>,
    pub sort_ms: Option<f64>,
    pub bin_ms: Option<f64>,
    pub draw_ms: Option<f64>,
    pub skipped: Option<String>,
}

impl RenderRow {
    pub fn spread(&self) -> Option<Spread> {
        Some(Spread { median: self.ms?, quartiles: [self.ms_q1?, self.ms_q3?] })
    }
}

pub fn text(rows: &[RenderRow]) -> String {
    let [prepare, sort, bin, draw] = STAGES;
    table(
        rows,
        [
            ("path", |row| row.path.to_string()),
            ("renderer", |row| row.renderer.to_string()),
            ("splats", |row| row.splats.to_string()),
            ("size", |row| format!("{}x{}", row.width, row.height)),
            ("ms/frame [quartiles]", |row| {
                row.spread().map_or_else(|| "skipped".to_owned(), |ms| ms.to_string())
            }),
            (prepare, |row| stage(row.prepare_ms)),
            (sort, |row| stage(row.sort_ms)),
            (bin, |row| stage(row.bin_ms)),
            (draw, |row| stage(row.draw_ms)),
        ],
    )
}

fn stage(ms: Option<f64>) -> String {
    ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}"))
}

pub fn notes(plan: &RenderPlan, rows: &[RenderRow]) -> Vec<String> {
    let mut notes = vec![format!(
        "Medians of {} frames from as many sides, in turns, after one warm-up frame. Stages are separate medians; - marks a stage that is not timed separately.",
        plan.frames
    )];
    if rows.iter().any(|row| row.path != FramePath::Cpu) {
        notes.push(
            "On a GPU a frame ends when its image is complete. Its stages are timed by the GPU."
                .to_owned(),
        );
    }
    let mut reasons: Vec<String> = rows
        .iter()
        .filter_map(|row| {
            let why = row.skipped.as_ref()?;
            Some(format!("skipped, {} with {} splats: {why}", row.path, row.splats))
        })
        .collect();
    // Both renderers are skipped for the same reason.
    reasons.dedup();
    notes.extend(reasons);
    notes
}

pub fn panels(plan: &RenderPlan, rows: &[RenderRow]) -> Vec<Panel> {
    let mut paths: Vec<FramePath> = rows.iter().map(|row| row.path).collect();
    // `dedup` removes only adjacent duplicates, and rows are grouped by size.
    paths.sort_by_key(|path| *path as usize);
    paths.dedup();
    let lines = || paths.iter().flat_map(|&path| RENDERERS.map(|renderer| (path, renderer)));
    let panel = |&[width, height]: &[u32; 2]| {
        let series = |(path, renderer)| {
            let is_mine = |row: &&RenderRow| {
                (row.path, row.renderer, row.width, row.height) == (path, renderer, width, height)
            };
            let mark =
                |row: &RenderRow| Some(Mark::new(Spread::exact(row.splats as f64), row.spread()?));
            // A combination that was not drawn has no mark.
            let marks = rows.iter().filter(is_mine).filter_map(mark);
            let name = format!("{renderer}, {path}");
            Series { name, marks: marks.collect(), connected: true }
        };
        Panel {
            title: format!("{width}x{height}"),
            x: Axis::Log("splats"),
            y: Axis::Log("ms per frame"),
            series: lines().map(series).filter(|line| !line.marks.is_empty()).collect(),
        }
    };
    plan.sizes.iter().map(panel).collect()
}
