//! Errors of saved runs.

use crate::dataset::error::DatasetError;
use crate::export::checkpoint::CheckpointError;
use crate::model::paper::merging::AddError;
use crate::pipeline::any_preset::Mismatch;
use crate::pipeline::error::SessionError;
use crate::train::candidates::IndexError;
use glam::DVec3;
use std::path::PathBuf;

/// Reason why a saved run cannot be used.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum RunError {
    /// The file could not be read or written.
    #[error("{0}")]
    File(#[from] CheckpointError),
    /// A JSON section has unexpected content.
    #[error("{}: section `{section}`: {problem}; use the program that wrote it", path.display())]
    Json { path: PathBuf, section: &'static str, problem: String },
    /// The stored model does not match the stored settings.
    #[error("{}: {mismatch}; use the program that wrote it", path.display())]
    Mismatch { path: PathBuf, mismatch: Mismatch },
    /// A requested setting differs from that of the run.
    #[error(
        "{setting}: expected {stored}, as {} was trained, found {asked}; leave it out, or train anew",
        path.display()
    )]
    Conflict { setting: &'static str, path: PathBuf, stored: String, asked: String },
    /// The dataset differs from the one the run was trained on.
    #[error(
        "{}: expected the dataset it was trained on, found one that differs in {difference}; name \
         the right dataset, or train on this one by `--force`", path.display()
    )]
    OtherDataset { path: PathBuf, difference: String },
    /// The dataset and the model have different local origins.
    #[error(
        "{}: expected cameras relative to its local origin {expected}, found them relative to {found}; \
         open the dataset with the checkpoint's options", path.display()
    )]
    LocalOrigin { path: PathBuf, expected: DVec3, found: DVec3 },
    /// The dataset has fewer frames than the run has visited.
    #[error(
        "{}: expected {expected} frames or more in the split, found {found}; name the dataset it \
         was trained on", path.display()
    )]
    TooFewFrames { path: PathBuf, expected: usize, found: usize },
    /// Two runs did not start from the same dataset, settings and initial model.
    #[error("{} and {}: expected the same {what} in both, found {found}; {advice}", paths[0].display(), paths[1].display())]
    Unlike { paths: [PathBuf; 2], what: String, found: String, advice: &'static str },
    /// A run does not continue the given earlier run.
    #[error(
        "{}: expected a run that continues {}, found {found}; train every shard with --resume of \
         that checkpoint and its own --shard", path.display(), origin.display()
    )]
    Origin { path: PathBuf, origin: PathBuf, found: &'static str },
    /// The runs share frames, which would be counted twice. `first` is the index of the first shared
    /// frame in the split.
    #[error(
        "{} and {}: expected no frame in both, found {n_frames}, the first {first}; merge models \
         trained on different frames, such as with --shard, or give their common start with \
         --start", paths[0].display(), paths[1].display()
    )]
    Overlap { paths: [PathBuf; 2], n_frames: usize, first: u32 },
    /// The statistics of two runs cannot be added exactly.
    #[error("{} and {}: {source}; train them with precision=mixed or f64", paths[0].display(), paths[1].display())]
    Add { paths: [PathBuf; 2], source: AddError },
    /// The dataset lacks something that the run needs.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The session could not be started.
    #[error("{0}")]
    Session(#[from] SessionError),
    /// The search index for candidate components could not be built.
    #[error("{0}")]
    Index(#[from] IndexError),
}
