//! Table, notes, ratios and plot of frame times.
//!
//! Ratios compare the renderers only for the same scene, size and path. A stage that a path does
//! not time separately is a dash, never zero.

use super::painter::{FramePath, STAGES};
use super::plan::{RENDERERS, RenderPlan};
use super::row::RenderRow;
use crate::bench::plot::Axis;
use crate::bench::plot::draw::{Mark, Panel, Series};
use crate::eval::metrics::Spread;
use crate::eval::report;
use crate::render::Renderer;
use serde::Serialize;

/// Values derived from the rows.
#[derive(Clone, Debug, Serialize)]
pub struct RenderSummary {
    /// Combinations for which both renderers were timed.
    pub ratios: Vec<Ratio>,
}

/// Time of the exact renderer relative to the projected one.
#[derive(Clone, Debug, Serialize)]
pub struct Ratio {
    pub path: FramePath,
    pub splats: usize,
    pub width: u32,
    pub height: u32,
    pub exact_over_projected: f64,
}

impl RenderSummary {
    /// Ratios of rows that differ only in the renderer.
    pub fn of(rows: &[RenderRow]) -> Self {
        let of = |renderer| rows.iter().filter(move |row: &&RenderRow| row.renderer == renderer);
        let place = |row: &RenderRow| (row.path, row.splats, row.width, row.height);
        let ratio = |projected: &RenderRow| {
            let exact = of(Renderer::Exact).find(|exact| place(exact) == place(projected))?;
            let (path, splats, width, height) = place(projected);
            let exact_over_projected = exact.ms? / projected.ms?;
            Some(Ratio { path, splats, width, height, exact_over_projected })
        };
        Self { ratios: of(Renderer::Projected).filter_map(ratio).collect() }
    }
}

pub fn text(rows: &[RenderRow]) -> String {
    let cells = |row: &RenderRow| {
        let total = row.spread().map_or_else(|| "skipped".to_owned(), |ms| ms.to_string());
        let stage = |ms: Option<f64>| ms.map_or_else(|| "-".to_owned(), |ms| format!("{ms:.2}"));
        let [prepare, sort, bin, draw] = row.stages().map(stage);
        let size = format!("{}x{}", row.width, row.height);
        let names = [row.path.to_string(), row.renderer.to_string()];
        let [path, renderer] = names;
        [path, renderer, row.splats.to_string(), size, total, prepare, sort, bin, draw]
    };
    let [prepare, sort, bin, draw] = STAGES;
    let header =
        ["path", "renderer", "splats", "size", "ms/frame [quartiles]", prepare, sort, bin, draw];
    report::text(header, &rows.iter().map(cells).collect::<Vec<_>>())
}

/// Describes the measurement, the largest ratio and the skipped rows.
pub fn notes(plan: &RenderPlan, rows: &[RenderRow], summary: &RenderSummary) -> Vec<String> {
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
    let ratios = summary.ratios.iter().map(|ratio| ratio.exact_over_projected);
    if let Some(most) = ratios.reduce(f64::max) {
        notes.push(format!("exact takes at most {most:.2} times as long as projected"));
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

/// One panel per resolution.
pub fn panels(plan: &RenderPlan, rows: &[RenderRow]) -> Vec<Panel> {
    let mut paths: Vec<FramePath> = rows.iter().map(|row| row.path).collect();
    paths.sort_by_key(|path| *path as usize);
    paths.dedup();
    let lines = || paths.iter().flat_map(|&path| RENDERERS.map(|renderer| (path, renderer)));
    let panel = |&[width, height]: &[u32; 2]| {
        let series = |(path, renderer)| {
            let is_mine = |row: &&RenderRow| {
                (row.path, row.renderer, row.width, row.height) == (path, renderer, width, height)
            };
            let marks = rows.iter().filter(is_mine).filter_map(|row| {
                Some(Mark { x: Spread::exact(row.splats as f64), y: row.spread()?, label: None })
            });
            let name = format!("{renderer}, {path}");
            Series { name, marks: marks.collect(), connected: true }
        };
        Panel {
            title: format!("{width}x{height}"),
            x: Axis::Log("splats".to_owned()),
            y: Axis::Log("ms per frame".to_owned()),
            series: lines().map(series).filter(|line| !line.marks.is_empty()).collect(),
        }
    };
    plan.sizes.iter().map(panel).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pairs_that_were_timed_have_a_ratio() {
        let row = |renderer, splats, ms| RenderRow {
            path: FramePath::Cpu,
            renderer,
            splats,
            width: 4,
            height: 3,
            frames: 1,
            ms,
            ms_q1: ms,
            ms_q3: ms,
            prepare_ms: None,
            sort_ms: None,
            bin_ms: None,
            draw_ms: None,
            skipped: None,
        };
        let rows = [
            row(Renderer::Projected, 10, Some(2.0)),
            row(Renderer::Exact, 10, Some(3.0)),
            row(Renderer::Projected, 20, Some(2.0)),
            row(Renderer::Exact, 20, None),
            row(Renderer::Exact, 30, Some(3.0)),
        ];
        let [ratio] = &RenderSummary::of(&rows).ratios[..] else { panic!() };
        assert_eq!((ratio.splats, ratio.exact_over_projected), (10, 1.5));
    }
}
