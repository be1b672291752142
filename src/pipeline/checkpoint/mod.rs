//! Runs on disk: a session saved at a frame boundary, read back, continued, and merged with others.

mod asked;
mod fingerprint;
mod merge;
mod pair;
mod resume;
mod save;

pub use asked::Asked;
pub use fingerprint::Fingerprint;
pub use merge::merge;

use super::machine;
use super::run::RunConfig;
use super::session::SessionError;
use crate::dataset::error::DatasetError;
use crate::export::checkpoint::{self, Checkpoint, CheckpointError, Loaded};
use crate::model::appearance::SplatSet;
use crate::model::merging::AddError;
use crate::train::candidates::IndexError;
use glam::DVec3;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Why a saved run cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The file.
    #[error("{0}")]
    File(#[from] CheckpointError),
    /// A JSON section is not what this program writes.
    #[error("{}: section `{section}`: {problem}; use the program that wrote it", path.display())]
    Json {
        /// The file.
        path: PathBuf,
        /// Tag of the section.
        section: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// The stored prior is not that of the stored settings.
    #[error(
        "{}: expected the prior that its settings imply, found another; use the program that wrote it",
        path.display()
    )]
    Prior {
        /// The file.
        path: PathBuf,
    },
    /// The stored model is not the one that the stored settings ask for.
    #[error(
        "{}: expected {expected}, as its settings say, found another; use the program that wrote it",
        path.display()
    )]
    Form {
        /// The file.
        path: PathBuf,
        /// What the settings ask for.
        expected: String,
    },
    /// A setting contradicts the one the run was begun with.
    #[error(
        "{setting}: expected {stored}, as {} was trained, found {asked}; leave the option out, or \
         train anew", path.display()
    )]
    Conflict {
        /// As the command line spells it.
        setting: String,
        /// The checkpoint.
        path: PathBuf,
        /// Its value.
        stored: String,
        /// The user's.
        asked: String,
    },
    /// Another dataset.
    #[error(
        "{}: expected the dataset it was trained on, found one that differs in {difference}; name \
         the right dataset", path.display()
    )]
    OtherDataset {
        /// The checkpoint.
        path: PathBuf,
        /// What differs, expected and found.
        difference: String,
    },
    /// The dataset lacks frames that were gone through.
    #[error(
        "{}: expected {expected} frames or more in the split, found {found}; name the dataset it \
         was trained on", path.display()
    )]
    TooFewFrames {
        /// The checkpoint.
        path: PathBuf,
        /// Frames the checkpoint speaks of.
        expected: usize,
        /// Frames of the dataset.
        found: usize,
    },
    /// Two runs did not begin alike.
    #[error("{} and {}: expected the same {what} in both, found {found}; {advice}", paths[0].display(), paths[1].display())]
    Unlike {
        /// The two checkpoints.
        paths: [PathBuf; 2],
        /// What must be the same.
        what: String,
        /// How they differ.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// A scene that depends on the order of frames.
    #[error(
        "{}: expected a scene that does not depend on the order of frames, found one trained with \
         {found}; train every shard with {advice}", path.display()
    )]
    Ordered {
        /// The checkpoint.
        path: PathBuf,
        /// The setting that makes it depend.
        found: String,
        /// The setting in its place.
        advice: &'static str,
    },
    /// A frame counted twice.
    #[error(
        "{} and {}: expected no frame in both, found {n_frames}, the first {first}; merge models \
         trained on different frames, such as with --shard", paths[0].display(), paths[1].display()
    )]
    Overlap {
        /// The two checkpoints.
        paths: [PathBuf; 2],
        /// Frames in both.
        n_frames: usize,
        /// Position of one in its split.
        first: u32,
    },
    /// The totals do not add up.
    #[error("{} and {}: {source}; train them with --precision mixed or f64", paths[0].display(), paths[1].display())]
    Add {
        /// The two checkpoints.
        paths: [PathBuf; 2],
        /// Why.
        source: AddError,
    },
    /// The dataset does not hold what the run needs.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The session does not start.
    #[error("{0}")]
    Session(#[from] SessionError),
    /// The candidate index could not be built.
    #[error("{0}")]
    Index(#[from] IndexError),
}

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
        run.pair()?;
        Ok(run)
    }

    /// Splats of all components, as the session's that was saved.
    pub fn splats(&self) -> Result<SplatSet, RunError> {
        Ok(self.learner()?.splats())
    }

    /// Direction that points up in the world.
    pub fn up(&self) -> DVec3 {
        DVec3::from_array(self.meta.up).try_normalize().unwrap_or(DVec3::Z)
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

fn parse<T: for<'de> Deserialize<'de>>(
    path: &Path,
    section: &'static str,
    json: &str,
) -> Result<T, RunError> {
    serde_json::from_str(json).map_err(|error| RunError::Json {
        path: path.to_owned(),
        section,
        problem: error.to_string(),
    })
}

/// JSON with sorted keys, so that equal values have equal bytes.
fn canonical(value: &impl Serialize) -> Result<String, serde_json::Error> {
    Ok(serde_json::to_value(value)?.to_string())
}
