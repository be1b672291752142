//! Reason why a window ended and the state it hands over to the next window.

use super::path_editor::PathEditor;
use super::viewer::kept::KeptView;
use crate::render::gpu::adapters::AdapterChoice;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Reason why a window ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Leave {
    /// The user closed it.
    #[default]
    Closed,
    /// Its graphics device was lost.
    DeviceLost,
    /// The user chose another graphics adapter.
    Adapter(AdapterChoice),
}

/// User state passed to a reopened window.
pub struct Handover {
    /// View and edits.
    pub view: KeptView,
    /// Camera path being edited.
    pub path: PathEditor,
}

/// Shared record of why a window ends and what it hands over. It outlives the window, whose own state is gone
/// after a panic.
#[derive(Clone, Default)]
pub struct Exit(Arc<Mutex<Word>>);

#[derive(Default)]
struct Word {
    why: Leave,
    handover: Option<Handover>,
}

impl Exit {
    /// Records the reason.
    pub fn leave(&self, why: Leave) {
        self.lock().why = why;
    }

    /// Recorded reason.
    pub fn why(&self) -> Leave {
        self.lock().why.clone()
    }

    /// Stores the state for the next window.
    pub fn hand_over(&self, handover: Handover) {
        self.lock().handover = Some(handover);
    }

    /// Takes the state stored by the previous window; `None` if there is none.
    pub fn taken_over(&self) -> Option<Handover> {
        self.lock().handover.take()
    }

    /// Creates the record of the next window with the stored state and no reason.
    pub fn of_next(&self) -> Self {
        Self(Arc::new(Mutex::new(Word { why: Leave::Closed, handover: self.taken_over() })))
    }

    fn lock(&self) -> MutexGuard<'_, Word> {
        // Every write is one assignment, so the value is valid even after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
