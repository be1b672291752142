//! Edit tab, and component attributes requested from the worker.

use super::Studio;
use crate::app::evidence_histogram::EvidenceHistogram;
use crate::app::panels::edit;
use crate::app::state::{RunState, Snapshot};
use crate::app::worker::WorkerOrder;
use eframe::egui::Ui;

impl Studio {
    pub(super) fn edit_tab(&mut self, ui: &mut Ui, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else {
            ui.label("Nothing is open.");
            return;
        };
        if let Some(command) = edit::ui(&mut self.view, snapshot, opened, ui) {
            self.apply_command(command, snapshot);
        }
    }

    /// Histogram of the components' evidence while training is paused; collecting it costs the trainer time.
    pub(super) fn evidence(&mut self, snapshot: &Snapshot) -> Option<EvidenceHistogram> {
        let is_at_rest = matches!(snapshot.state, RunState::Paused | RunState::Finished);
        let (editor, palette) = self.view.editor_and_palette();
        is_at_rest.then(|| editor.evidence(palette)).flatten()
    }

    /// Requests the component attributes needed by colours, edits and panels. Call it after drawing the view,
    /// which leaves modes unavailable for the scene, and after the panels.
    pub(super) fn request_attributes(&mut self) {
        let watched = self.view.take_watched_attribute();
        if watched != self.requested_attribute {
            self.requested_attribute = watched;
            self.worker.send(WorkerOrder::Watch(watched));
        }
    }
}
