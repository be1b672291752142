//! Progress and frame reports of a run so far.

use crate::dataset::Dataset;
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::train::outcome::ComparedPhotograph;

/// Progress and frame reports of a run so far.
#[derive(Clone)]
pub(super) struct RunProgress {
    /// Number of visited positions of the plan.
    pub visited: usize,
    /// Number of pixels that the points represent.
    pub points: u64,
    /// Reports of the trained frames, as far as known.
    pub frames: Vec<FrameReport>,
    pub skipped: Vec<SkippedFrame>,
    /// Training time in seconds.
    pub wall_s: f64,
}

impl RunProgress {
    /// Starts empty, with the frames that the dataset refused when it was opened as skipped.
    pub fn at_start(dataset: &Dataset, split: usize) -> Self {
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

    /// Stores how a photograph compared in its frame's report, after `n_learnt` frames. Returns a warning if
    /// the frame is a new outlier.
    pub fn record_comparison(
        &mut self,
        n_learnt: u64,
        compared: &ComparedPhotograph,
    ) -> Option<String> {
        let at = self.report_index(n_learnt, compared)?;
        let report = self.frames.get_mut(at)?;
        let is_told = report.outlier_warning().is_some();
        report.photograph = Some(compared.outcome);
        report.outlier_warning().filter(|_| !is_told)
    }

    /// Report of the frame whose photograph was compared, after `n_learnt` frames.
    pub fn report_of(&self, n_learnt: u64, compared: &ComparedPhotograph) -> Option<&FrameReport> {
        self.frames.get(self.report_index(n_learnt, compared)?)
    }

    fn report_index(&self, n_learnt: u64, compared: &ComparedPhotograph) -> Option<usize> {
        // The reports of the first frames of a resumed run may be unknown.
        let n_before = n_learnt.checked_sub(self.frames.len() as u64)?;
        usize::try_from(compared.frame.checked_sub(n_before)?).ok()
    }
}
