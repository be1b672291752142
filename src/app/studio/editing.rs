//! Edits of the scene, as far as they are more than the view's.

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

    /// How many components have how much evidence, of a scene at rest: telling it takes the trainer's time.
    pub(super) fn evidence(&mut self, snapshot: &Snapshot) -> Option<EvidenceHistogram> {
        let is_at_rest = matches!(snapshot.state, RunState::Paused | RunState::Finished);
        let (editor, palette) = self.view.editing();
        is_at_rest.then(|| editor.evidence(palette)).flatten()
    }

    /// Has the worker tell of components what colours, edits and panels need. To be called after the view
    /// was drawn, which leaves modes that this scene cannot show, and after the panels.
    pub(super) fn watch_components(&mut self) {
        let watched = self.view.take_watched();
        if watched != self.watched {
            self.watched = watched;
            self.worker.send(WorkerOrder::Watch(watched));
        }
    }
}
