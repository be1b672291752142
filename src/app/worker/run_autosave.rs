//! State of the autosave of the open run.

use crate::app::abandoned::AutosaveSlot;
use crate::pipeline::autosave::Autosave;
use std::time::Instant;

pub enum RunAutosave {
    /// Nothing was saved yet; since this moment there is something to save, if there is.
    Waiting(Option<Instant>),
    /// Saves to a claimed slot.
    On(Autosave, AutosaveSlot),
    /// Off: it failed, of which the user was warned, or does not apply.
    Off,
}
