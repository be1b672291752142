//! From a session to a file, while whoever asked waits. [`Autosave`](crate::pipeline::autosave::Autosave)
//! does so without waiting.

use super::error::RunError;
use crate::export::checkpoint::{self, Checkpoint};
use crate::pipeline::error::SessionError;
use crate::pipeline::session::Session;
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

    /// Everything a later session needs to go on as if this one had not stopped. Copies the model.
    pub fn checkpoint(&self) -> Result<Checkpoint, SessionError> {
        self.snapshot().into_checkpoint()
    }
}
