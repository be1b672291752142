//! Errors of starting and continuing a session.

use super::any_preset::Mismatch;
use super::memory::MemoryError;
use super::prefetch::SpawnError;
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::range::RangeError;
use crate::train::candidates::IndexError;

/// Reason why a session cannot start or continue.
#[allow(missing_docs, reason = "every message names its fields")]
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The dataset lacks what was requested.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The scene preset cannot start on the dataset.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// The range of positions could not be estimated.
    #[error("{0}")]
    Range(#[from] RangeError),
    /// A decoding thread could not be started.
    #[error("{0}")]
    Spawn(#[from] SpawnError),
    /// The machine has too little memory.
    #[error("{0}")]
    Memory(#[from] MemoryError),
    /// The search index for candidate components could not be built.
    #[error("{0}")]
    Index(#[from] IndexError),
    /// Several passes were requested without training on photographs, but further passes use only
    /// photographs.
    #[error(
        "passes: expected 1 without photometric training, found {0}: points count once; train on photographs, or use one pass"
    )]
    Passes(usize),
    /// A setting is incompatible with tracking.
    #[error("poses (`--poses track`): expected {expected}, found {found}")]
    Tracking { expected: &'static str, found: String },
    /// A stored model does not match the settings stored with it.
    #[error("{0}")]
    Stored(Mismatch),
    /// Settings or reports could not be serialized as JSON.
    #[error("writing the run's settings as JSON failed: {0}; report this as a defect")]
    Json(#[from] serde_json::Error),
    /// Every frame was skipped.
    #[error(
        "{dataset}: expected at least one usable frame, found none ({skipped} skipped; the first: {first})"
    )]
    NoUsableFrame { dataset: String, skipped: usize, first: String },
}
