//! The two ways splats become pixels on a GPU, and what each costs.

use strum::Display;

/// How splats become pixels. Both give the same image.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Display)]
#[strum(serialize_all = "kebab-case")]
pub enum DrawPath {
    /// Blended quads, in the order of the CPU.
    Quads,
    /// Sorted and blended by compute shaders.
    Tiles,
}

/// Milliseconds on the GPU of the stages of one image; `None` where a path has no such stage.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GpuTimes {
    /// Splats to records.
    pub preprocess: Option<f64>,
    /// Records into their order.
    pub sort: Option<f64>,
    /// Records to pixels; with quads, splats to pixels.
    pub draw: f64,
}

impl GpuTimes {
    /// Sum of the stages, milliseconds.
    pub fn total(&self) -> f64 {
        self.preprocess.unwrap_or(0.0) + self.sort.unwrap_or(0.0) + self.draw
    }
}
