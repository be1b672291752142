//! Frame reports of a run, as stored in checkpoints.

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
    /// Serializes like [`canonical`], one frame at a time: sorting a long run at once would take ten times
    /// the memory.
    pub fn canonical(&self) -> Result<String, serde_json::Error> {
        let frames: Result<Vec<String>, _> = self.frames.iter().map(canonical).collect();
        let skipped = canonical(&self.skipped)?;
        Ok(format!("{{\"frames\":[{}],\"skipped\":{skipped}}}", frames?.join(",")))
    }
}
