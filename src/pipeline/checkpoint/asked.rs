//! Comparison of settings given with `--resume` against those of the run.
//!
//! Each value is compared in its own type, because a comparison as JSON would miss settings that were
//! renamed or moved. Model settings are compared by the preset's table, settings of frames and depth by
//! this module.

use super::error::RunError;
use super::saved::{History, SavedRun, parse};
use crate::dataset::fingerprint::Fingerprint;
use crate::dataset::splits::HoldOut;
use crate::dataset::{Dataset, LoadOptions};
use crate::export::checkpoint::Checkpoint;
use crate::pipeline::error::SessionError;
use crate::pipeline::frame_loop::InitialState;
use crate::pipeline::memory;
use crate::pipeline::plan::{Order, Plan, Selection, Shard};
use crate::pipeline::run::RunProgress;
use crate::pipeline::session::Session;
use crate::pipeline::settings::GivenSettings;
use crate::train::setting::Preset;
use crate::train::setting::table::Conflict;
use crate::train::setting::value::text_of;
use serde::Serialize;
use std::fmt::Debug;
use std::sync::Arc;

/// Settings requested for a resumed run. `None` keeps the run's value.
#[derive(Clone, Debug, Default)]
pub struct ResumeRequest {
    /// Preset of the model.
    pub preset: Option<Preset>,
    /// Settings of the model.
    pub model: GivenSettings,
    /// Split to train on.
    pub split: Option<String>,
    /// Order of the frames.
    pub order: Option<Order>,
    /// Stride: only every N-th frame is used.
    pub stride: Option<usize>,
    /// Shard: the part of the frames that one of several runs trains on.
    pub shard: Option<Shard>,
    /// Options for reading depth files.
    pub load: LoadOptions,
    /// Maximum number of frames, including those already visited. May differ from the run's value.
    pub max_frames: Option<usize>,
    /// Total number of passes, including completed ones. It may differ from the number in the saved run.
    pub passes: Option<usize>,
    /// True to follow the recording while it grows.
    pub follow: bool,
    /// Rule that selects the frames held out for evaluation.
    pub hold_out: Option<HoldOut>,
}

impl SavedRun {
    /// Checks the request against the run's settings.
    ///
    /// # Errors
    /// [`RunError::Conflict`] states the option, the run's value and the requested one.
    pub fn check(&self, asked: &ResumeRequest) -> Result<(), RunError> {
        let method = &self.config.method;
        // The preset first: with another one, every setting of the model would differ too.
        let conflict = differs("preset (`--preset`)", &asked.preset, &Some(method.preset()))
            .or_else(|| asked.model.conflict(method))
            .or_else(|| frame_conflict(asked, &self.config.selection))
            .or_else(|| depth_conflict(&asked.load, &self.config.load));
        match conflict {
            None => Ok(()),
            Some(Conflict { setting, stored, requested: asked }) => {
                let stored = stored.unwrap_or_else(|| "no value".to_owned());
                Err(RunError::Conflict { setting, path: self.path.clone(), stored, asked })
            }
        }
    }
}

fn frame_conflict(asked: &ResumeRequest, stored: &Selection) -> Option<Conflict> {
    // Frame limit, shard, passes and `follow` may differ.
    [
        differs("split (`--split`)", &asked.split, &stored.split),
        differs("order", &asked.order, &Some(stored.order)),
        differs("stride", &asked.stride, &Some(stored.stride)),
        differs("hold out (`--hold-out`)", &asked.hold_out, &Some(stored.hold_out)),
    ]
    .into_iter()
    .flatten()
    .next()
}

fn depth_conflict(asked: &LoadOptions, stored: &LoadOptions) -> Option<Conflict> {
    // Destructured completely, so that a new option causes a compile error here.
    let LoadOptions {
        depth_scale,
        depth_range,
        poses,
        intrinsics,
        confidence,
        geometry_only: _,
        track: _,
        // Not options of the command line; taken from the checkpoint.
        local_origin: _,
        calibrated_photographs: _,
    } = asked;
    // An absent flag requests nothing.
    let grey = |load: &LoadOptions| load.geometry_only.then_some(true);
    let tracked = |load: &LoadOptions| load.track.then_some(true);
    [
        differs("depth scale (`--depth-scale`)", depth_scale, &stored.depth_scale),
        differs("depth range (`--depth-range`)", depth_range, &stored.depth_range),
        differs("pose axes (`--pose-axes`)", poses, &stored.poses),
        differs("intrinsics (`--intrinsics`)", intrinsics, &stored.intrinsics),
        differs("confidence (`--confidence`)", confidence, &stored.confidence),
        differs("geometry only (`--geometry-only`)", &grey(asked), &grey(stored)),
        differs("poses (`--poses track`)", &tracked(asked), &tracked(stored)),
    ]
    .into_iter()
    .flatten()
    .next()
}

fn differs<T: PartialEq + Serialize + Debug>(
    setting: &'static str,
    asked: &Option<T>,
    stored: &Option<T>,
) -> Option<Conflict> {
    let requested = asked.as_ref().filter(|_| asked != stored)?;
    Some(Conflict { setting, stored: stored.as_ref().map(text_of), requested: text_of(requested) })
}

impl SavedRun {
    /// Resumes the run on its dataset.
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
        let Checkpoint { history, cursor, model, .. } = content;
        // Shards of one start continue the same estimates. If each of them learned the start's buffered photographs
        // again, fusion would take what they have in common for information of as many shards.
        let seed = config.method.as_any().seed();
        let begins_shard = match asked.shard {
            None => false,
            Some(shard) => {
                Plan::begins_shard(&dataset, &config.selection, seed, &cursor.visited, shard)?
            }
        };
        let settled = begins_shard.then(|| config.method.as_any().settled(&model)).flatten();
        let model = settled.unwrap_or(model);
        config.selection.max_frames = asked.max_frames.or(config.selection.max_frames);
        if begins_shard {
            config.selection.shard = asked.shard;
            config.selection.start_frames = cursor.visited.len();
        }
        // At least the visits so far, so that the plan contains all of them.
        config.selection.passes = asked.passes.unwrap_or(config.selection.passes).max(most_visits);
        let plan = Plan::resumed(&dataset, &config.selection, seed, &cursor.visited)?;
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
        // The machine may be another one.
        memory::fit(config.method.as_any_mut(), plan.pixels(&dataset))
            .map_err(SessionError::from)?;
        let mut past = RunProgress::at_start(&dataset, plan.split);
        past.visited = cursor.visited.len();
        past.points = cursor.points;
        past.wall_s = meta.wall_s;
        past.registration = meta.registration;
        if let Some(history) = history {
            let history: History = parse(&path, "HIST", &history)?;
            (past.frames, past.skipped, past.curves) =
                (history.frames, history.skipped, history.curves);
        }
        let origin = InitialState::Stored(&model, cursor.frames);
        Ok(Session::begin(dataset, config, plan, &origin, past)?)
    }
}
