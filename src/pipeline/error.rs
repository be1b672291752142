//! Why a session cannot start or go on.

use super::memory::MemoryError;
use super::mismatch::Mismatch;
use super::prefetch::SpawnError;
use super::settings::scene::SceneError;
use crate::dataset::error::DatasetError;
use crate::dataset::range::RangeError;
use crate::train::candidates::IndexError;

/// Why a session cannot start or go on.
#[derive(Debug, thiserror::Error)]
pub enum SessionError {
    /// The dataset does not hold what was asked for.
    #[error("{0}")]
    Dataset(#[from] DatasetError),
    /// The scene preset does not suit the dataset.
    #[error("{0}")]
    Scene(#[from] SceneError),
    /// The range of positions could not be found.
    #[error("{0}")]
    Range(#[from] RangeError),
    /// The decoding thread did not start.
    #[error("{0}")]
    Spawn(#[from] SpawnError),
    /// The machine has not enough memory.
    #[error("{0}")]
    Memory(#[from] MemoryError),
    /// The candidate index could not be built.
    #[error("{0}")]
    Index(#[from] IndexError),
    /// Frames are to be gone through again, and would teach nothing.
    #[error(
        "passes: expected 1 where photographs are not learnt, found {0}: points count once; learn photographs, or go through the frames once"
    )]
    Passes(usize),
    /// Tracking cannot go with another setting.
    #[error("--poses track: expected {expected}, found {found}")]
    Tracking {
        /// What tracking needs.
        expected: &'static str,
        /// The setting in its way.
        found: String,
    },
    /// A stored model is not one of the settings stored beside it.
    #[error("{0}")]
    Stored(Mismatch),
    /// Settings or reports could not be written as JSON.
    #[error("writing the run's settings as JSON failed: {0}; report this as a defect")]
    Json(#[from] serde_json::Error),
    /// Every frame was skipped.
    #[error(
        "{dataset}: expected at least one usable frame, found none ({skipped} skipped; the first: {first})"
    )]
    NoUsableFrame {
        /// Name of the dataset.
        dataset: String,
        /// Frames skipped.
        skipped: usize,
        /// Message of the first one.
        first: String,
    },
}
