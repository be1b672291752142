//! Why a saved run cannot be used.

use crate::dataset::error::DatasetError;
use crate::export::checkpoint::CheckpointError;
use crate::model::paper::merging::AddError;
use crate::pipeline::error::SessionError;
use crate::train::candidates::IndexError;
use glam::DVec3;
use std::path::PathBuf;

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
    /// Cameras told relative to another place than the model.
    #[error(
        "{}: expected cameras relative to its local origin {expected}, found them relative to {found}; \
         open the dataset with the checkpoint's options", path.display()
    )]
    LocalOrigin {
        /// The checkpoint.
        path: PathBuf,
        /// Its local origin.
        expected: DVec3,
        /// The dataset's.
        found: DVec3,
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
    /// A run that did not go on from the one named.
    #[error(
        "{}: expected a run that went on from {}, found {found}; train every shard with --resume of \
         that checkpoint and its own --shard", path.display(), origin.display()
    )]
    Origin {
        /// The checkpoint.
        path: PathBuf,
        /// What it should have gone on from.
        origin: PathBuf,
        /// What speaks against it.
        found: &'static str,
    },
    /// A frame counted twice.
    #[error(
        "{} and {}: expected no frame in both, found {n_frames}, the first {first}; merge models \
         trained on different frames, such as with --shard, or name what they went on from with \
         --start", paths[0].display(), paths[1].display()
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
