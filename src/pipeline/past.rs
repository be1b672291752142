//! What a run has behind it.

use crate::dataset::Dataset;
use crate::eval::report::{FrameReport, SkippedFrame};

/// What a run has behind it when a session begins.
#[derive(Clone)]
pub(super) struct Past {
    /// Positions of the plan gone through.
    pub visited: usize,
    /// Pixels that the points learnt stand for.
    pub points: u64,
    /// Reports of the frames learnt, as far as they are known.
    pub frames: Vec<FrameReport>,
    /// Frames that could not be used.
    pub skipped: Vec<SkippedFrame>,
    /// Seconds spent.
    pub wall_s: f64,
}

impl Past {
    /// Nothing but the frames that the dataset refused when it was opened.
    pub fn none(dataset: &Dataset, split: usize) -> Self {
        let name = &dataset.splits[split].name;
        let refused = dataset.warnings.iter().filter(|w| w.split == *name);
        Self {
            visited: 0,
            points: 0,
            frames: Vec::new(),
            skipped: refused.map(|w| SkippedFrame::from(&*w.error)).collect(),
            wall_s: 0.0,
        }
    }
}
