//! Reason why a window ended, and the state that it hands over to the next one.

use super::mailbox::Mailbox;
use super::path_editor::PathEditor;
use super::viewer::KeptView;
use crate::render::gpu::adapters::AdapterChoice;
use std::sync::Arc;

#[derive(Clone, Debug, Default, PartialEq)]
pub enum ExitReason {
    #[default]
    Closed,
    DeviceLost,
    /// The user chose another graphics adapter.
    Adapter(AdapterChoice),
}

/// User state passed to a reopened window.
pub struct Handover {
    pub view: KeptView,
    pub path: PathEditor,
}

/// Reason why a window ends, and the state for the next one. Shared, because a panic destroys the window's
/// own state.
#[derive(Clone, Default)]
pub struct Exit {
    pub reason: Arc<Mailbox<ExitReason>>,
    pub handover: Arc<Mailbox<Option<Handover>>>,
}

impl Exit {
    /// Creates the record of the next window with the stored state and no reason.
    pub fn for_next_window(&self) -> Self {
        // Shared, not moved: a window that fails to open has not taken the state.
        Self { reason: Arc::default(), handover: self.handover.clone() }
    }
}
