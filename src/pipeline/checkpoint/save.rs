//! From a session to a file, while whoever asked waits. [`Autosave`](crate::pipeline::autosave::Autosave)
//! does so without waiting.

use super::SavedRun;
use super::error::RunError;
use crate::export::checkpoint::{self, Checkpoint};
use crate::pipeline::error::SessionError;
use crate::pipeline::panic_text::{NO_WORDS, panic_text};
use crate::pipeline::session::Session;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

impl Session {
    /// Writes a checkpoint, whole or not at all; returns its size.
    pub fn save(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write(path, &self.checkpoint()?)?)
    }

    /// Like [`Session::save`]; an older file of that name stays as `<name>.bak`.
    pub fn save_keeping_old(&self, path: &Path) -> Result<u64, RunError> {
        Ok(checkpoint::write_keeping_old(path, &self.checkpoint()?)?)
    }

    /// Saves what a panic may have left in the middle of a frame. Only a file that can be read again counts:
    /// one that cannot must not be found later and taken for the scene, and is removed.
    ///
    /// # Errors
    /// Why there is no such file, in words; what a second panic said, too.
    pub fn save_after_panic(&self, path: &Path) -> Result<(), String> {
        let attempt = || -> Result<(), String> {
            self.save(path).map_err(|error| error.to_string())?;
            let read = SavedRun::read(path).map(drop).map_err(|error| error.to_string());
            read.inspect_err(|_| drop(std::fs::remove_file(path)))
        };
        catch_unwind(AssertUnwindSafe(attempt))
            .unwrap_or_else(|panic| Err(panic_text(&*panic).unwrap_or(NO_WORDS).to_owned()))
    }

    /// Everything a later session needs to go on as if this one had not stopped. Copies the model.
    pub fn checkpoint(&self) -> Result<Checkpoint, SessionError> {
        self.snapshot().into_checkpoint()
    }
}
