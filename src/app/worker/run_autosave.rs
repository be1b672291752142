//! How the open run is saved on its way.

use crate::app::abandoned::AutosaveSlot;
use crate::pipeline::autosave::Autosave;
use std::time::Instant;

/// How the open run is saved on its way.
pub enum RunAutosave {
    /// Nothing had to be saved yet; from this moment on there is something, if there is.
    Waiting(Option<Instant>),
    /// Into a slot of its own.
    On(Autosave, AutosaveSlot),
    /// Not any more, which the user was told, or not at all.
    Off,
}
