//! Reason why a window ended and the state it hands over to the next window.

use super::path_editor::PathEditor;
use super::viewer::KeptView;
use crate::render::gpu::adapters::AdapterChoice;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Reason why a window ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum ExitReason {
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
pub struct Exit(Arc<Mutex<ExitRecord>>);

#[derive(Default)]
struct ExitRecord {
    reason: ExitReason,
    handover: Option<Handover>,
}

impl Exit {
    /// Records the reason.
    pub fn set_reason(&self, why: ExitReason) {
        self.lock().reason = why;
    }

    /// Recorded reason.
    pub fn reason(&self) -> ExitReason {
        self.lock().reason.clone()
    }

    /// Stores the state for the next window.
    pub fn hand_over(&self, handover: Handover) {
        self.lock().handover = Some(handover);
    }

    /// Takes the state stored by the previous window; `None` if there is none.
    pub fn take_handover(&self) -> Option<Handover> {
        self.lock().handover.take()
    }

    /// Creates the record of the next window with the stored state and no reason.
    pub fn for_next_window(&self) -> Self {
        Self(Arc::new(Mutex::new(ExitRecord {
            reason: ExitReason::Closed,
            handover: self.take_handover(),
        })))
    }

    fn lock(&self) -> MutexGuard<'_, ExitRecord> {
        // Every write is one assignment, so the value is valid even after a panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
