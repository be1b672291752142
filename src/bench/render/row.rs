//! Rows of the table of frame times.

use super::painter::{FramePath, STAGES};
use crate::eval::metrics::Spread;
use crate::render::Renderer;
use serde::Serialize;

/// One timed combination. Times are medians per frame in milliseconds, with quartiles. `None` if
/// nothing was drawn or a stage is not timed separately.
#[derive(Clone, Debug, Serialize)]
pub struct RenderRow {
    pub path: FramePath,
    pub renderer: Renderer,
    pub splats: usize,
    pub width: u32,
    pub height: u32,
    /// Timed frames. 0 if nothing was drawn.
    pub frames: usize,
    pub ms: Option<f64>,
    pub ms_q1: Option<f64>,
    pub ms_q3: Option<f64>,
    /// Computing image records of splats.
    pub prepare_ms: Option<f64>,
    /// Sorting splats by depth.
    pub sort_ms: Option<f64>,
    /// Building the splat lists of the tiles.
    pub bin_ms: Option<f64>,
    /// Drawing pixels.
    pub draw_ms: Option<f64>,
    /// Reason why nothing was drawn.
    pub skipped: Option<String>,
}

impl RenderRow {
    /// Median and quartiles. `None` if nothing was drawn.
    pub fn spread(&self) -> Option<Spread> {
        Some(Spread { median: self.ms?, quartiles: [self.ms_q1?, self.ms_q3?] })
    }

    /// Medians of the stages, in the order of `STAGES`.
    pub fn stages(&self) -> [Option<f64>; STAGES.len()] {
        [self.prepare_ms, self.sort_ms, self.bin_ms, self.draw_ms]
    }
}
