//! What is timed and how long it takes: one row of the table.

use crate::eval::spread::Spread;
use serde::Serialize;

/// The size that is swept.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Sweep {
    /// Points of a frame.
    Points,
    /// Number of components N.
    Components,
    /// Threads of the pool.
    Threads,
}

/// Where the initial means lie.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum MeanPlacement {
    /// The paper's start: most are far from every point.
    Random,
    /// Points of other frames: the state after reassignment.
    Surface,
}

/// How a frame is processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum EnginePath {
    /// Grid, mixed precision, fused statistics.
    Fast,
    /// KD-tree, f64, unfused statistics.
    Plain,
}

/// The lines of the plot; the plain ones follow the fast ones in the same order of means.
pub const LINES: [(MeanPlacement, EnginePath); 4] = [
    (MeanPlacement::Random, EnginePath::Fast),
    (MeanPlacement::Surface, EnginePath::Fast),
    (MeanPlacement::Random, EnginePath::Plain),
    (MeanPlacement::Surface, EnginePath::Plain),
];

/// One timed combination.
#[derive(Clone, Debug, Serialize)]
pub struct ScalingRow {
    /// What grows from row to row.
    pub sweep: Sweep,
    /// Points of the frame.
    pub points: usize,
    /// Number of components N.
    pub components: usize,
    /// Threads of the pool.
    pub threads: usize,
    /// Where the means lie.
    pub means: MeanPlacement,
    /// How the frame is processed.
    pub path: EnginePath,
    /// Median milliseconds per frame.
    pub ms: f64,
    /// First quartile over the frames, milliseconds.
    pub ms_q1: f64,
    /// Third quartile over the frames, milliseconds.
    pub ms_q3: f64,
    /// Median milliseconds of the candidate search.
    pub candidates_ms: f64,
    /// Median milliseconds of scores and responsibilities.
    pub e_step_ms: f64,
    /// Median milliseconds of sums per tile.
    pub stats_ms: f64,
    /// Median milliseconds of the addition to the totals.
    pub update_ms: f64,
    /// Median of the plain path, timed in turns with this one, over this one.
    pub plain_over_this: f64,
}

impl ScalingRow {
    /// Place on the axis of the sweep: the size that is swept.
    pub fn position(&self) -> f64 {
        let size = match self.sweep {
            Sweep::Points => self.points,
            Sweep::Components => self.components,
            Sweep::Threads => self.threads,
        };
        size as f64
    }

    /// Median and quartiles, milliseconds per frame.
    pub fn spread(&self) -> Spread {
        Spread { median: self.ms, quartiles: [self.ms_q1, self.ms_q3] }
    }
}
