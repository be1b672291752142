//! One row of the table of frame times.

use super::painter::{FramePath, STAGES};
use crate::eval::metrics::Spread;
use crate::render::Renderer;
use serde::Serialize;

/// One timed combination.
#[derive(Clone, Debug, Serialize)]
pub struct RenderRow {
    /// How the frames came about.
    pub path: FramePath,
    /// Whether splats are projected or integrated exactly.
    pub renderer: Renderer,
    /// Splats of the scene.
    pub splats: usize,
    /// Columns of the image.
    pub width: u32,
    /// Rows of the image.
    pub height: u32,
    /// Number of timed frames; 0 where it could not be drawn.
    pub frames: usize,
    /// Median milliseconds per frame; `None` where it could not be drawn.
    pub ms: Option<f64>,
    /// First quartile over the frames, milliseconds.
    pub ms_q1: Option<f64>,
    /// Third quartile over the frames, milliseconds.
    pub ms_q3: Option<f64>,
    /// Milliseconds from splats to records of the image; stages that cannot be told apart are
    /// `None`.
    pub prepare_ms: Option<f64>,
    /// Milliseconds of ordering the splats by depth.
    pub sort_ms: Option<f64>,
    /// Milliseconds of listing the splats of every tile.
    pub bin_ms: Option<f64>,
    /// Milliseconds of drawing the pixels.
    pub draw_ms: Option<f64>,
    /// Why it could not be drawn.
    pub skipped: Option<String>,
}

impl RenderRow {
    /// Median and quartiles, milliseconds per frame; `None` where it could not be drawn.
    pub fn spread(&self) -> Option<Spread> {
        Some(Spread { median: self.ms?, quartiles: [self.ms_q1?, self.ms_q3?] })
    }

    /// Medians of the stages, milliseconds, in the order of `STAGES`.
    pub fn stages(&self) -> [Option<f64>; STAGES.len()] {
        [self.prepare_ms, self.sort_ms, self.bin_ms, self.draw_ms]
    }
}
