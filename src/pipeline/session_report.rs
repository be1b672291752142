//! Reports of a session.

use super::run::RunConfig;
use super::session::Session;
use crate::eval::machine;
use crate::eval::report::{DatasetReport, EvalReport, FrameReport, REPORT_FORMAT, Report, Summary};

impl Session {
    /// Reports of the frames whose photographs were compared in the last step, as far as known: the newest,
    /// and buffered ones.
    pub fn compared_frames(&self) -> impl Iterator<Item = &FrameReport> {
        let (past, n_learnt) = (self.past(), self.learner().frames());
        let compared = self.learner().compared_photographs().iter();
        compared.filter_map(move |compared| past.report_of(n_learnt, compared))
    }

    fn drawn(&self) -> usize {
        self.stored_splats().view().splats().iter().filter(|splat| splat.opacity > 0.0).count()
    }

    /// Returns the report so far; `adapter` is the name of the graphics adapter used for rendering, if any.
    pub fn report(&self, adapter: Option<String>, eval: Vec<EvalReport>) -> Report<RunConfig> {
        let (dataset, plan, past) = (self.dataset(), self.plan(), self.past());
        let split = &dataset.splits[plan.split];
        let first = plan.frames.first().map(|&i| split.frames[i].camera.intrinsics);
        let path = dataset.path.as_ref();
        Report {
            format: REPORT_FORMAT,
            dataset: DatasetReport {
                path: path.map_or_else(|| dataset.name.clone(), |p| p.display().to_string()),
                layout: dataset.layout.name().to_owned(),
                split: split.name.clone(),
                frames: plan.frames.len(),
                width: first.map_or(0, |k| k.width),
                height: first.map_or(0, |k| k.height),
            },
            config: self.config().clone(),
            machine: machine::describe(adapter),
            frames: past.frames.clone(),
            skipped: past.skipped.clone(),
            summary: Summary {
                components: self.learner().components(),
                used: self.learner().used(),
                drawn: self.drawn(),
                model_bytes: self.learner().model_bytes(),
                peak_rss_bytes: machine::peak_rss_bytes(),
                ..Summary::of_frames(&past.frames, past.wall_s)
            },
            eval,
            seen: Vec::new(),
            tracking: None,
            comparer: self.learner().comparer_use(),
            passes: self.learner().pass_use(),
            points: self.learner().point_use(),
        }
    }
}
