//! Blocking saves of a session; [`Autosave`](crate::pipeline::autosave::Autosave) saves in the background.

use super::SavedRun;
use super::error::RunError;
use crate::export::checkpoint::{self, Checkpoint};
use crate::pipeline::error::SessionError;
use crate::pipeline::panic_text::{NO_MESSAGE, panic_text};
use crate::pipeline::session::Session;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

impl Session {
    /// Writes a checkpoint atomically; returns its size in bytes.
    pub fn save(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write(path, &self.checkpoint()?)?)
    }

    /// Writes like [`Session::save`] and retains an existing file as `<name>.bak`.
    pub fn save_keeping_old(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write_keeping_old(path, &self.checkpoint()?)?)
    }

    /// Saves the state after a panic, possibly in the middle of a frame. A file that cannot be read back is
    /// removed, so that it is never mistaken for a valid scene.
    ///
    /// # Errors
    /// Message of why no file was saved, including that of a second panic.
    pub fn save_after_panic(&self, path: &Path) -> Result<(), String> {
        let attempt = || -> Result<(), String> {
            self.save(path).map_err(|error| error.to_string())?;
            let read = SavedRun::read(path).map(drop).map_err(|error| error.to_string());
            read.inspect_err(|_| drop(std::fs::remove_file(path)))
        };
        catch_unwind(AssertUnwindSafe(attempt))
            .unwrap_or_else(|panic| Err(panic_text(&*panic).unwrap_or(NO_MESSAGE).to_owned()))
    }

    /// Returns everything needed to resume this session bit for bit. Copies the model.
    pub fn checkpoint(&self) -> Result<Checkpoint, SessionError> {
        self.snapshot().into_checkpoint()
    }
}
