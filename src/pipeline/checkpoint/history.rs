//! What a run has to say of its frames, as checkpoints keep it.

use super::json::canonical;
use crate::eval::report::{FrameReport, SkippedFrame};
use serde::{Deserialize, Serialize};

/// Content of the `HIST` section.
#[derive(Serialize, Deserialize)]
pub(super) struct History {
    pub frames: Vec<FrameReport>,
    pub skipped: Vec<SkippedFrame>,
}

impl History {
    /// As [`canonical`] writes it, a frame at a time: all of a long run at once are ten times as large
    /// while they are sorted.
    pub fn canonical(&self) -> Result<String, serde_json::Error> {
        let frames: Result<Vec<String>, _> = self.frames.iter().map(canonical).collect();
        let skipped = canonical(&self.skipped)?;
        Ok(format!("{{\"frames\":[{}],\"skipped\":{skipped}}}", frames?.join(",")))
    }
}
