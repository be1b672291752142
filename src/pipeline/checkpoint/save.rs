//! From a session to a checkpoint.

use super::error::RunError;
use super::json::canonical;
use super::saved::Meta;
use crate::dataset::fingerprint::Fingerprint;
use crate::eval::machine;
use crate::eval::report::{FrameReport, SkippedFrame};
use crate::export::checkpoint::{self, Checkpoint, Cursor};
use crate::pipeline::error::SessionError;
use crate::pipeline::session::Session;
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::time::{SystemTime, UNIX_EPOCH};

/// Content of the `HIST` section.
#[derive(Serialize, Deserialize)]
pub(super) struct History {
    pub frames: Vec<FrameReport>,
    pub skipped: Vec<SkippedFrame>,
}

impl History {
    /// As [`canonical`] writes it, a frame at a time: all of a long run at once are ten times as large
    /// while they are sorted.
    fn canonical(&self) -> Result<String, serde_json::Error> {
        let frames: Result<Vec<String>, _> = self.frames.iter().map(canonical).collect();
        let skipped = canonical(&self.skipped)?;
        Ok(format!("{{\"frames\":[{}],\"skipped\":{skipped}}}", frames?.join(",")))
    }
}

impl Session {
    /// Writes a checkpoint, whole or not at all; returns its size.
    pub fn save(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write(path, &self.checkpoint()?)?)
    }

    /// Like [`Session::save`]; an older file of that name stays as `<name>.bak`.
    pub fn save_keeping_old(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write_keeping_old(path, &self.checkpoint()?)?)
    }

    /// Everything a later session needs to go on as if this one had not stopped. Copies the model.
    pub fn checkpoint(&self) -> Result<Checkpoint, SessionError> {
        let (past, plan) = (self.past(), self.plan());
        let meta = Meta {
            program: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            saved_unix_s: now_unix_s(),
            dataset: self.dataset().path.as_ref().map(|path| {
                // A path that cannot be made absolute still says more than none.
                std::path::absolute(path).unwrap_or_else(|_| path.clone())
            }),
            fingerprint: Fingerprint::of(self.dataset(), plan.split),
            up: self.up().to_array(),
            planned_frames: plan.frames.len(),
            wall_s: past.wall_s,
        };
        let history = History { frames: past.frames.clone(), skipped: past.skipped.clone() };
        Ok(Checkpoint {
            config: canonical(self.config())?,
            meta: canonical(&meta)?,
            numerics: machine::numerics(),
            history: Some(history.canonical()?),
            cursor: Cursor {
                frames: self.learner().frames(),
                points: past.points,
                visited: plan.frames[..past.visited].iter().map(|&frame| frame as u32).collect(),
            },
            model: self.learner().stored(),
        })
    }
}

pub(super) fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}
