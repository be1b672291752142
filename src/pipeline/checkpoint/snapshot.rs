//! Snapshot of a session between two frames: the only part of saving that blocks training.
//!
//! Fingerprint, JSON, checksums and the disk take longer than a frame, and grow with the number of frames.
//! None of them needs the learner, so they run later on any thread.

use super::SavedRun;
use super::error::RunError;
use super::saved::{History, Meta, canonical};
use crate::dataset::Dataset;
use crate::dataset::fingerprint::Fingerprint;
use crate::eval::report;
use crate::export::checkpoint;
use crate::export::checkpoint::{Checkpoint, Cursor, MAX_JSON_BYTES};
use crate::model::attributes::StoredModel;
use crate::pipeline::error::SessionError;
use crate::pipeline::panic_report::PanicReport;
use crate::pipeline::run::{RunConfig, RunProgress};
use crate::pipeline::session::Session;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{SystemTime, UNIX_EPOCH};

/// Everything needed to resume a session bit for bit, copied at a frame boundary.
pub struct SessionSnapshot {
    dataset: Arc<Dataset>,
    /// Index of the split in the dataset.
    split: usize,
    config: RunConfig,
    past: RunProgress,
    planned_frames: usize,
    cursor: Cursor,
    model: StoredModel,
}

impl Session {
    /// Returns a copy of the model and the frame reports, which another thread can save.
    pub fn snapshot(&self) -> SessionSnapshot {
        let (past, plan) = (self.past(), self.plan());
        SessionSnapshot {
            dataset: self.dataset().clone(),
            split: plan.split,
            config: self.config().clone(),
            past: past.clone(),
            planned_frames: plan.frames.len(),
            cursor: Cursor {
                frames: self.learner().status().frames,
                points: past.points,
                visited: plan.frames.iter().take(past.visited).map(|&frame| frame as u32).collect(),
            },
            model: self.learner().checkpoint_model(),
        }
    }

    /// Returns everything needed to resume this session bit for bit. Copies the model.
    pub fn checkpoint(&self) -> Result<Checkpoint, SessionError> {
        self.snapshot().into_checkpoint()
    }

    /// Writes a checkpoint atomically; returns its size in bytes.
    pub fn save(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write(path, &self.checkpoint()?)?)
    }

    /// Writes like [`Session::save`] and retains an existing file as `<name>.bak`.
    pub fn save_keeping_old(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write_keeping_old(path, self.checkpoint()?)?)
    }

    /// Saves the state after a panic, possibly in the middle of a frame. Writes only what can be read back.
    /// Retains an older file as `<name>.bak`.
    ///
    /// # Errors
    /// Message that states why no file was saved; after a second panic, the message of that panic.
    pub fn save_after_panic(&self, path: &Path) -> Result<(), String> {
        let attempt = || -> Result<(), String> {
            let content = self.checkpoint().map_err(|error| error.to_string())?;
            // Checked as the file will be, before it is written: reading it back takes twice its size in memory.
            let run = SavedRun::new(path, content).map_err(|error| error.to_string())?;
            let written = checkpoint::write_keeping_old(path, &run.content);
            written.map(drop).map_err(|error| error.to_string())
        };
        // The state after a panic may be inconsistent and panic again.
        catch_unwind(AssertUnwindSafe(attempt))
            .unwrap_or_else(|panic| Err(PanicReport::of(&*panic).to_string()))
    }
}

impl SessionSnapshot {
    /// Number of trained frames.
    pub fn frames(&self) -> u64 {
        self.cursor.frames
    }

    /// Converts the snapshot to the contents of a checkpoint.
    ///
    /// # Errors
    /// [`SessionError::Json`] for settings or reports that JSON cannot represent.
    pub fn into_checkpoint(self) -> Result<Checkpoint, SessionError> {
        let Self { dataset, split, config, past, planned_frames, cursor, model } = self;
        let RunProgress { frames, skipped, curves, registration, wall_s, .. } = past;
        let meta = Meta {
            program: concat!(env!("CARGO_PKG_NAME"), " ", env!("CARGO_PKG_VERSION")).to_owned(),
            saved_unix_s: now_unix_s(),
            dataset: dataset.path.as_ref().map(|path| {
                // Relative or lossy paths are better than none; JSON requires UTF-8.
                let path = std::path::absolute(path).unwrap_or_else(|_| path.clone());
                PathBuf::from(path.to_string_lossy().into_owned())
            }),
            fingerprint: Fingerprint::of(&dataset, split),
            up: dataset.up(split).to_array(),
            planned_frames,
            registration,
            wall_s,
        };
        let history = History { frames, skipped, curves: curves.finite() };
        Ok(Checkpoint {
            config: canonical(&config)?,
            meta: canonical(&meta)?,
            numerics: report::numerics(),
            history: if_readable(history.canonical()?),
            cursor,
            model,
        })
    }
}

/// Returns the history, or `None` if it is too long to be read back.
fn if_readable(history: String) -> Option<String> {
    // Some hundred thousand frames exceed the limit, and the checkpoint stays readable without their reports.
    (history.len() <= MAX_JSON_BYTES).then_some(history)
}

pub(super) fn now_unix_s() -> u64 {
    // A clock set before 1970 must not prevent saving.
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_history_that_no_reader_takes_is_left_out() {
        let longest = " ".repeat(MAX_JSON_BYTES);
        assert_eq!(if_readable(longest.clone() + " "), None);
        assert_eq!(if_readable(longest).map(|text| text.len()), Some(MAX_JSON_BYTES));
    }
}
