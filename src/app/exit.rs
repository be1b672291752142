//! Reason why a window ended and the state it hands over to the next window.

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

/// Shared record of why a window ends and what it hands over. It outlives the window, whose own state is gone
/// after a panic.
#[derive(Clone, Default)]
pub struct Exit {
    reason: Arc<Mailbox<ExitReason>>,
    handover: Arc<Mailbox<Option<Handover>>>,
}

impl Exit {
    pub fn set_reason(&self, why: ExitReason) {
        self.reason.set(why);
    }

    pub fn reason(&self) -> ExitReason {
        self.reason.get()
    }

    pub fn hand_over(&self, handover: Handover) {
        self.handover.set(Some(handover));
    }

    pub fn take_handover(&self) -> Option<Handover> {
        self.handover.take()
    }

    /// Creates the record of the next window with the stored state and no reason.
    pub fn for_next_window(&self) -> Self {
        Self { reason: Arc::default(), handover: self.handover.clone() }
    }
}
