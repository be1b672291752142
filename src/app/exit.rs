//! Why a window ends, and what it leaves to the next one, told by whatever ends it to whoever opened it.

use super::path_editor::PathEditor;
use super::viewer::kept::KeptView;
use crate::render::gpu::adapters::AdapterChoice;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Why a window ended.
#[derive(Clone, Debug, Default, PartialEq)]
pub enum Leave {
    /// The user closed it.
    #[default]
    Closed,
    /// Its graphics device is gone.
    DeviceLost,
    /// The user chose another adapter.
    Adapter(AdapterChoice),
}

/// What the user made in a window that has to be opened anew.
pub struct Handover {
    /// Where the view stands, with its edits.
    pub view: KeptView,
    /// The camera path that is being made.
    pub path: PathEditor,
}

/// Where a window leaves word why it ends. It outlives the window, whose own state is gone after a
/// panic.
#[derive(Clone, Default)]
pub struct Exit(Arc<Mutex<Word>>);

#[derive(Default)]
struct Word {
    why: Leave,
    handover: Option<Handover>,
}

impl Exit {
    /// Leaves word.
    pub fn leave(&self, why: Leave) {
        self.lock().why = why;
    }

    /// The word left.
    pub fn why(&self) -> Leave {
        self.lock().why.clone()
    }

    /// Leaves what the user made to the next window.
    pub fn hand_over(&self, handover: Handover) {
        self.lock().handover = Some(handover);
    }

    /// What the window before has left, once.
    pub fn taken_over(&self) -> Option<Handover> {
        self.lock().handover.take()
    }

    /// For the next window, which has not ended: what was left to it, and no word.
    pub fn of_next(&self) -> Self {
        Self(Arc::new(Mutex::new(Word { why: Leave::Closed, handover: self.taken_over() })))
    }

    fn lock(&self) -> MutexGuard<'_, Word> {
        // A window that panicked while it left word has left it whole: every write is one assignment.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}
