//! What a run has behind it.

use crate::dataset::Dataset;
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::train::outcome::ComparedPhotograph;

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

    /// Notes with its frame how a photograph compared, after so many frames learnt; what is to be told of it.
    pub fn compared(&mut self, n_learnt: u64, compared: &ComparedPhotograph) -> Option<String> {
        let at = self.place_of(n_learnt, compared)?;
        let report = self.frames.get_mut(at)?;
        let is_told = report.doubt().is_some();
        report.photograph = Some(compared.outcome);
        report.doubt().filter(|_| !is_told)
    }

    /// The report of the frame whose photograph was compared, after so many frames learnt.
    pub fn report_of(&self, n_learnt: u64, compared: &ComparedPhotograph) -> Option<&FrameReport> {
        self.frames.get(self.place_of(n_learnt, compared)?)
    }

    fn place_of(&self, n_learnt: u64, compared: &ComparedPhotograph) -> Option<usize> {
        // Reports of the first frames of a long run that went on may not be known.
        let n_before = n_learnt.checked_sub(self.frames.len() as u64)?;
        usize::try_from(compared.frame.checked_sub(n_before)?).ok()
    }
}
