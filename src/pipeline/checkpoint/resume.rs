//! Resuming a session from a checkpoint.

use super::asked::ResumeRequest;
use super::error::RunError;
use super::history::History;
use super::json::parse;
use super::saved::SavedRun;
use crate::dataset::Dataset;
use crate::dataset::fingerprint::Fingerprint;
use crate::export::checkpoint::Checkpoint;
use crate::pipeline::past::RunProgress;
use crate::pipeline::plan::Plan;
use crate::pipeline::session::Session;
use crate::pipeline::start::InitialState;
use std::sync::Arc;

impl SavedRun {
    /// Resumes the run on the dataset it was trained on.
    ///
    /// # Errors
    /// [`RunError::Conflict`] for settings other than the run's, [`RunError::OtherDataset`] unless `force`,
    /// or any error of starting a session.
    pub fn resume(
        self,
        dataset: Arc<Dataset>,
        asked: &ResumeRequest,
        force: bool,
    ) -> Result<Session, RunError> {
        self.check(asked)?;
        let (expected, found) = (self.local_origin(), dataset.local_origin());
        // Not even with `force`: every position would be off by the difference.
        if expected != found {
            return Err(RunError::LocalOrigin { path: self.path, expected, found });
        }
        let most_visits = self.most_visited_frame().1;
        let Self { path, mut config, meta, content, .. } = self;
        let Checkpoint { history, cursor, mut model, .. } = content;
        if asked.shard.is_some_and(|shard| config.selection.shard != Some(shard)) {
            model.drop_stored_frames();
        }
        config.selection.max_frames = asked.max_frames.or(config.selection.max_frames);
        config.selection.shard = asked.shard.or(config.selection.shard);
        config.selection.passes = asked.passes.unwrap_or(config.selection.passes).max(most_visits);
        let plan = Plan::resumed(
            &dataset,
            &config.selection,
            config.method.as_any().seed(),
            &cursor.visited,
        )?;
        // A followed recording may have grown since.
        let found = match asked.follow || config.selection.follow {
            true => Fingerprint::of_first_frames(&dataset, plan.split, meta.fingerprint.frames()),
            false => Fingerprint::of(&dataset, plan.split),
        };
        if let Some(difference) = meta.fingerprint.difference(&found).filter(|_| !force) {
            return Err(RunError::OtherDataset { path, difference });
        }
        let n_frames = dataset.splits.get(plan.split).map_or(0, |split| split.frames.len());
        let expected = cursor.visited.iter().max().map_or(0, |&last| last as usize + 1);
        if expected > n_frames {
            return Err(RunError::TooFewFrames { path, expected, found: n_frames });
        }
        let mut past = RunProgress::at_start(&dataset, plan.split);
        past.visited = cursor.visited.len();
        past.points = cursor.points;
        past.wall_s = meta.wall_s;
        if let Some(history) = history {
            let history: History = parse(&path, "HIST", &history)?;
            (past.frames, past.skipped) = (history.frames, history.skipped);
        }
        let origin = InitialState::Stored(&model, cursor.frames);
        Ok(Session::begin(dataset, config, plan, &origin, past)?)
    }
}
