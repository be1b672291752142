//! The two drawing paths on a GPU and their timings.

use strum::Display;

/// Drawing path. Both give the same image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
#[strum(serialize_all = "kebab-case")]
pub enum DrawPath {
    /// Blended quads in the order sorted on the CPU.
    Quads,
    /// Sorting and blending by compute shaders.
    Tiles,
}

/// GPU times of the stages of one image in milliseconds; `None` if the path lacks the stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuTimes {
    /// Converting splats to records.
    pub preprocess: Option<f64>,
    /// Sorting records by depth and tile.
    pub sort: Option<f64>,
    /// Drawing records; for quads, drawing splats.
    pub draw: f64,
}

impl GpuTimes {
    /// Sum of the stages, milliseconds.
    pub fn total(&self) -> f64 {
        self.preprocess.unwrap_or(0.0) + self.sort.unwrap_or(0.0) + self.draw
    }
}
