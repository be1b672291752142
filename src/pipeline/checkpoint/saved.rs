//! A run read from a checkpoint.

use super::error::RunError;
use super::history::History;
use super::json::parse;
use crate::dataset::fingerprint::Fingerprint;
use crate::dataset::{Layout, LoadOptions};
use crate::eval::machine;
use crate::export::checkpoint::{self, Checkpoint, Loaded};
use crate::model::splat::appearance::SplatSet;
use crate::pipeline::any_preset::Revived;
use crate::pipeline::mismatch::Mismatch;
use crate::pipeline::plan::MAX_PASSES;
use crate::pipeline::run::RunConfig;
use crate::pipeline::tracked::Trajectory;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// What the `META` section says.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Meta {
    /// Program and version.
    pub program: String,
    /// Seconds from 1970 to the moment of saving.
    pub saved_unix_s: u64,
    /// Folder of the dataset, absolute; `None` for the procedural scene.
    pub dataset: Option<PathBuf>,
    /// What the dataset is recognised by.
    pub fingerprint: Fingerprint,
    /// Direction that points up in the world.
    pub up: [f64; 3],
    /// Frames the run was to go through.
    pub planned_frames: usize,
    /// Seconds spent so far.
    pub wall_s: f64,
}

/// A run read from a checkpoint.
#[derive(Clone, Debug)]
pub struct SavedRun {
    /// The file.
    pub path: PathBuf,
    /// Version of its format, major and minor.
    pub version: (u16, u16),
    /// Its size.
    pub bytes: u64,
    /// Every setting that shaped the run.
    pub config: RunConfig,
    /// Where it comes from.
    pub meta: Meta,
    /// Everything else.
    pub content: Checkpoint,
}

impl SavedRun {
    /// Reads and checks a checkpoint.
    pub fn read(path: &Path) -> Result<Self, RunError> {
        let Loaded { checkpoint: content, version, bytes } = checkpoint::read(path)?;
        let config: RunConfig = parse(path, "CONF", &content.config)?;
        let meta = parse(path, "META", &content.meta)?;
        let run = Self { path: path.to_owned(), version, bytes, config, meta, content };
        run.config.method.any().check(&run.content.model).map_err(|why| run.mismatch(why))?;
        run.check_visits()?;
        Ok(run)
    }

    /// How often the frame was gone through that was so most often.
    pub(super) fn most_visits(&self) -> (u32, usize) {
        let mut visited = self.content.cursor.visited.clone();
        visited.sort_unstable();
        let runs =
            visited.chunk_by(|a, b| a == b).filter_map(|run| Some((*run.first()?, run.len())));
        runs.max_by_key(|run| run.1).unwrap_or_default()
    }

    /// No frame may have been learnt oftener than its run has passes, nor a run go on for ever.
    fn check_visits(&self) -> Result<(), RunError> {
        let passes = self.config.selection.passes;
        let refuse =
            |section, problem| Err(RunError::Json { path: self.path.clone(), section, problem });
        if !(1..=MAX_PASSES).contains(&passes) {
            return refuse("CONF", format!("expected 1 to {MAX_PASSES} passes, found {passes}"));
        }
        match self.most_visits() {
            (frame, n) if n > passes => refuse(
                "CURS",
                format!(
                    "expected every frame {passes} times at most, found frame {frame} {n} times"
                ),
            ),
            _ => Ok(()),
        }
    }

    /// Splats as the session's files hold them.
    pub fn splats(&self) -> Result<SplatSet, RunError> {
        Ok(self.revive()?.learner.stored_splats())
    }

    /// Where its frames were found, if it was tracked and its history is short enough to be kept.
    ///
    /// # Errors
    /// [`RunError::Json`] for a history that is none.
    pub fn trajectory(&self) -> Result<Option<Trajectory>, RunError> {
        let Some(history) = &self.content.history else { return Ok(None) };
        let history: History = parse(&self.path, "HIST", history)?;
        Ok(Trajectory::of(&history.frames, &history.skipped))
    }

    /// The model as it is drawn, ready to go on, and world to model coordinates.
    ///
    /// # Errors
    /// [`RunError::Form`], [`RunError::Prior`] or [`RunError::Json`] unless model and settings
    /// belong together.
    pub fn revive(&self) -> Result<Revived, RunError> {
        let (model, frames) = (&self.content.model, self.content.cursor.frames);
        let revived = self.config.method.any().revive(model, frames);
        let mut revived = revived.map_err(|why| self.mismatch(why))?;
        revived.learner.settle();
        Ok(revived)
    }

    /// Names the file in which model and settings do not belong together.
    fn mismatch(&self, why: Mismatch) -> RunError {
        let path = self.path.clone();
        match why {
            Mismatch::Prior => RunError::Prior { path },
            Mismatch::Form(expected) => RunError::Form { path, expected },
            Mismatch::Setting(problem) => RunError::Json { path, section: "CONF", problem },
            Mismatch::Index(error) => RunError::Index(error),
        }
    }

    /// Direction that points up in the world.
    pub fn up(&self) -> DVec3 {
        DVec3::from_array(self.meta.up).try_normalize().unwrap_or(DVec3::Z)
    }

    /// How its dataset is opened beside it: with the origin that the model's positions are relative to.
    pub fn load_options(&self) -> LoadOptions {
        self.config.load.settled()
    }

    /// What its positions are relative to, in the world of its dataset.
    pub fn local_origin(&self) -> DVec3 {
        self.config.load.local_origin.map_or(DVec3::ZERO, DVec3::from_array)
    }

    /// Whether the world is known to be in metres: as its layout says, and not where the user gave scale
    /// and range of depth another unit.
    pub fn is_metric(&self) -> bool {
        let load = &self.config.load;
        let is_given = load.depth_scale.is_some() && load.depth_range.is_some();
        !is_given && self.meta.fingerprint.layout().is_some_and(Layout::is_metric)
    }

    /// A sentence, if results on this machine may differ from those on the one that saved the run.
    pub fn numerics_differ(&self) -> Option<String> {
        let here = machine::numerics();
        (here != self.content.numerics).then(|| {
            format!(
                "{}: saved on a machine or build with {}, going on with {here}: results may differ in the last bits",
                self.path.display(),
                self.content.numerics
            )
        })
    }
}
