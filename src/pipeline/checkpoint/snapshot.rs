//! A session as it stood between two frames: the one part of saving that training waits for.
//!
//! Fingerprint, JSON, checksums and the disk take longer than a frame, the longer the more frames
//! there were. None of them needs the learner, so they are left to whoever holds the snapshot, on
//! whichever thread.

use super::history::History;
use super::json::canonical;
use super::saved::Meta;
use crate::dataset::Dataset;
use crate::dataset::fingerprint::Fingerprint;
use crate::eval::machine;
use crate::export::checkpoint::{Checkpoint, Cursor, MAX_JSON_BYTES};
use crate::model::stored::StoredModel;
use crate::pipeline::error::SessionError;
use crate::pipeline::past::Past;
use crate::pipeline::run::RunConfig;
use crate::pipeline::session::Session;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Everything a later session needs to go on as if this one had not stopped, copied at a frame
/// boundary.
pub struct SessionSnapshot {
    dataset: Arc<Dataset>,
    /// Position of the split in the dataset.
    split: usize,
    config: RunConfig,
    past: Past,
    planned_frames: usize,
    cursor: Cursor,
    model: StoredModel,
}

impl Session {
    /// Copies what a checkpoint is made of: the model, and a line for every frame.
    pub fn snapshot(&self) -> SessionSnapshot {
        let (past, plan) = (self.past(), self.plan());
        SessionSnapshot {
            dataset: self.dataset().clone(),
            split: plan.split,
            config: self.config().clone(),
            past: past.clone(),
            planned_frames: plan.frames.len(),
            cursor: Cursor {
                frames: self.learner().frames(),
                points: past.points,
                visited: plan.frames.iter().take(past.visited).map(|&frame| frame as u32).collect(),
            },
            model: self.learner().stored(),
        }
    }
}

impl SessionSnapshot {
    /// Frames learnt by then.
    pub fn frames(&self) -> u64 {
        self.cursor.frames
    }

    /// Puts the copy into words.
    ///
    /// # Errors
    /// [`SessionError::Json`] for settings or reports that JSON cannot hold.
    pub fn into_checkpoint(self) -> Result<Checkpoint, SessionError> {
        let Self { dataset, split, config, past, planned_frames, cursor, model } = self;
        let meta = Meta {
            program: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            saved_unix_s: now_unix_s(),
            dataset: dataset.path.as_ref().map(|path| {
                // A path that cannot be made absolute still says more than none, and so does one that
                // is no UTF-8, as JSON must be, with what can be said of it.
                let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
                PathBuf::from(path.to_string_lossy().into_owned())
            }),
            fingerprint: Fingerprint::of(&dataset, split),
            up: dataset.up(split).to_array(),
            planned_frames,
            wall_s: past.wall_s,
        };
        let history = History { frames: past.frames, skipped: past.skipped };
        Ok(Checkpoint {
            config: canonical(&config)?,
            meta: canonical(&meta)?,
            numerics: machine::numerics(),
            history: readable(history.canonical()?),
            cursor,
            model,
        })
    }
}

/// A history that can be read again: that of some hundred thousand frames cannot, and a checkpoint
/// does without rather than being refused with it.
fn readable(history: String) -> Option<String> {
    (history.len() <= MAX_JSON_BYTES).then_some(history)
}

pub(super) fn now_unix_s() -> u64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_history_that_no_reader_takes_is_left_out() {
        let longest = " ".repeat(MAX_JSON_BYTES);
        assert_eq!(readable(longest.clone() + " "), None);
        assert_eq!(readable(longest).map(|text| text.len()), Some(MAX_JSON_BYTES));
    }
}
