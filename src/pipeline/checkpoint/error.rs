//! Errors of saved runs.

use crate::dataset::error::DatasetError;
use crate::export::checkpoint::CheckpointError;
use crate::model::paper::merging::AddError;
use crate::pipeline::error::SessionError;
use crate::train::candidates::IndexError;
use glam::DVec3;
use std::path::PathBuf;

/// Reason why a saved run cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The file could not be read or written.
    #[error("{0}")]
    File(#[from] CheckpointError),
    /// A JSON section has unexpected content.
    #[error("{}: section `{section}`: {problem}; use the program that wrote it", path.display())]
    Json {
        /// Path of the file.
        path: PathBuf,
        /// Tag of the section.
        section: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// The stored prior does not match the stored settings.
    #[error(
        "{}: expected the prior that its settings imply, found another; use the program that wrote it",
        path.display()
    )]
    Prior {
        /// Path of the file.
        path: PathBuf,
    },
    /// The stored model does not match the stored settings.
    #[error(
        "{}: expected {expected} according to its settings, found another; use the program that \
         wrote it",
        path.display()
    )]
    Form {
        /// Path of the file.
        path: PathBuf,
        /// Model form that the settings require.
        expected: String,
    },
    /// A setting differs from the run's.
    #[error(
        "{setting}: expected {stored}, as {} was trained, found {asked}; leave it out, or train anew",
        path.display()
    )]
    Conflict {
        /// Name of the setting, with its option if it has one.
        setting: &'static str,
        /// Path of the checkpoint.
        path: PathBuf,
        /// Value in the checkpoint.
        stored: String,
        /// Requested value.
        asked: String,
    },
    /// The dataset is another one.
    #[error(
        "{}: expected the dataset it was trained on, found one that differs in {difference}; name \
         the right dataset, or train on this one by `--force`", path.display()
    )]
    OtherDataset {
        /// Path of the checkpoint.
        path: PathBuf,
        /// What differs, expected and found.
        difference: String,
    },
    /// The dataset and the model have different local origins.
    #[error(
        "{}: expected cameras relative to its local origin {expected}, found them relative to {found}; \
         open the dataset with the checkpoint's options", path.display()
    )]
    LocalOrigin {
        /// Path of the checkpoint.
        path: PathBuf,
        /// Local origin of the checkpoint.
        expected: DVec3,
        /// Local origin of the dataset.
        found: DVec3,
    },
    /// The dataset has fewer frames than were visited.
    #[error(
        "{}: expected {expected} frames or more in the split, found {found}; name the dataset it \
         was trained on", path.display()
    )]
    TooFewFrames {
        /// Path of the checkpoint.
        path: PathBuf,
        /// Minimum number of frames.
        expected: usize,
        /// Number of frames in the dataset.
        found: usize,
    },
    /// Two runs did not start alike.
    #[error("{} and {}: expected the same {what} in both, found {found}; {advice}", paths[0].display(), paths[1].display())]
    Unlike {
        /// Paths of both checkpoints.
        paths: [PathBuf; 2],
        /// What must be equal.
        what: String,
        /// How they differ.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// A run does not continue the given one.
    #[error(
        "{}: expected a run that continues {}, found {found}; train every shard with --resume of \
         that checkpoint and its own --shard", path.display(), origin.display()
    )]
    Origin {
        /// Path of the checkpoint.
        path: PathBuf,
        /// Path of the run it should continue.
        origin: PathBuf,
        /// Evidence against it.
        found: &'static str,
    },
    /// A frame would count twice.
    #[error(
        "{} and {}: expected no frame in both, found {n_frames}, the first {first}; merge models \
         trained on different frames, such as with --shard, or give their common start with \
         --start", paths[0].display(), paths[1].display()
    )]
    Overlap {
        /// Paths of both checkpoints.
        paths: [PathBuf; 2],
        /// Number of common frames.
        n_frames: usize,
        /// Index of the first one in its split.
        first: u32,
    },
    /// The statistics cannot be added exactly.
    #[error("{} and {}: {source}; train them with precision=mixed or f64", paths[0].display(), paths[1].display())]
    Add {
        /// Paths of both checkpoints.
        paths: [PathBuf; 2],
        /// Cause.
        source: AddError,
    },
    /// The dataset lacks something that the run needs.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
    /// The candidate index could not be built.
    #[error("{0}")]
    Index(#[from] IndexError),
}
