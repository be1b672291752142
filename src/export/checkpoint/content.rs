//! What a checkpoint holds, in memory.

use crate::model::stored::StoredModel;

/// What a checkpoint holds. The JSON texts are opaque here: `pipeline` writes and reads them.
#[derive(Clone, Debug, PartialEq)]
pub struct Checkpoint {
    /// Every setting that shaped the run.
    pub config: String,
    /// Program, time and dataset.
    pub meta: String,
    /// What the last bits of results depend on besides the settings.
    pub numerics: String,
    /// Reports of the frames so far.
    pub history: Option<String>,
    /// How far the run is.
    pub cursor: Cursor,
    /// The model of either preset, all its statistics included.
    pub model: StoredModel,
}

/// How far a run is.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Cursor {
    /// Number of frames learnt.
    pub frames: u64,
    /// Number of points learnt, over all frames.
    pub points: u64,
    /// Positions in their split of the frames gone through, learnt or skipped, in order; each once.
    pub visited: Vec<u32>,
}

/// A checkpoint and the file it was read from.
#[derive(Clone, Debug, PartialEq)]
pub struct Loaded {
    /// What the file held, checked.
    pub checkpoint: Checkpoint,
    /// Version of the format, major and minor.
    pub version: (u16, u16),
    /// Size of the file.
    pub bytes: u64,
}
