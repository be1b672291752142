//! Contents of a checkpoint, in memory.

use crate::model::stored::StoredModel;

/// Contents of a checkpoint. The JSON texts are opaque here; `pipeline` writes and reads them.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// JSON: every setting that affects the result.
    pub config: String,
    /// JSON: program, time and dataset.
    pub meta: String,
    /// JSON: everything besides the settings that affects the last bits of the result.
    pub numerics: String,
    /// JSON: reports of the frames trained on so far.
    pub history: Option<String>,
    /// Progress of the run.
    pub cursor: Cursor,
    /// Model of either preset, with all its sufficient statistics.
    pub model: StoredModel,
}

/// Progress of a run.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Number of frames trained on.
    pub frames: u64,
    /// Number of points trained on, over all frames.
    pub points: u64,
    /// Indices in their split of the frames visited (trained on or skipped), in order, each once.
    pub visited: Vec<u32>,
}

/// Checkpoint read from a file.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedCheckpoint {
    /// Validated contents.
    pub checkpoint: Checkpoint,
    /// Format version, major and minor.
    pub version: (u16, u16),
    /// Size of the file in bytes.
    pub bytes: u64,
}
