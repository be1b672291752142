//! Cards over the viewport: before training and after the last frame.

use super::Studio;
use crate::app::color_mode::ColorMode;
use crate::app::detail::{finer, retrainable_run};
use crate::app::panels::card::CardPlace;
use crate::app::panels::ready;
use crate::app::panels::summary::{self, SummaryAnswer};
use crate::app::state::{Opened, RunState, Snapshot, Source};
use crate::app::tab::SideTab;
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::mode::ViewMode;
use crate::app::worker::WorkerOrder;
use crate::train::scene::units::StructuralScale;
use eframe::egui::Ui;

impl Studio {
    /// Draws the card of the current state, if it has one, below `noticed` points of notices.
    pub(super) fn cards(&mut self, ui: &Ui, snapshot: &Snapshot, noticed: f32) {
        let Some(opened) = &snapshot.opened else { return };
        let place = CardPlace::below(noticed, ui);
        if snapshot.state == RunState::Ready && snapshot.frames_done == 0 {
            self.ready_card(opened, place, ui, snapshot);
        }
        let is_read = self.closed_summary_serial == opened.serial;
        let is_plain = self.view.mode() == ViewMode::Single
            && self.view.settings.color_mode == ColorMode::Color;
        let is_done = snapshot.state == RunState::Finished && snapshot.source == Source::Dataset;
        if is_done && is_plain && !is_read {
            self.summary_card(opened, place, ui, snapshot);
        }
    }

    fn ready_card(&mut self, opened: &Opened, place: CardPlace, ui: &Ui, snapshot: &Snapshot) {
        let first = FrameRef::trained(opened, 0);
        let photo = match (self.view.thumbnails(opened), &first) {
            (Some(thumbnails), Some(first)) => thumbnails.get(ui.ctx(), first, true),
            _ => None,
        };
        if let Some(command) = ready::ui(snapshot, opened, photo, place, ui) {
            self.apply_command(command, snapshot);
        }
    }

    fn summary_card(&mut self, opened: &Opened, place: CardPlace, ui: &Ui, snapshot: &Snapshot) {
        let finer = finer(snapshot);
        let forecast = finer.map(|scale| {
            let scale = match scale {
                StructuralScale::Pixels(n) => format!("{n:.2} pixels"),
                StructuralScale::World(length) => format!("{length:.2e} world units"),
            };
            format!(
                "Train on the same frames again with a structural scale of {scale}: about {} components. The view stays",
                2 * snapshot.used
            )
        });
        match summary::ui(snapshot, &self.quality, forecast.as_deref(), place, ui) {
            None => {}
            Some(SummaryAnswer::Close) => self.closed_summary_serial = opened.serial,
            Some(SummaryAnswer::Quality) => self.layout.activate(SideTab::Quality),
            Some(SummaryAnswer::Command(command)) => self.apply_command(command, snapshot),
            Some(SummaryAnswer::Finer) => {
                self.training.scene.scale = finer;
                self.retrain(snapshot);
            }
        }
    }

    /// Trains on the same frames with the current settings; the view stays.
    pub(super) fn retrain(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let settings = Box::new(self.training.clone());
        // Sent even if the user then cancels discarding: the settings apply to the next run.
        self.worker.send(WorkerOrder::TrainBy(settings.clone()));
        self.view.retain_camera_for(opened);
        self.confirm_then_send(WorkerOrder::Retrain(settings), snapshot);
    }

    /// Applies a level of detail chosen after opening, if no frame is trained yet.
    pub(super) fn apply_detail(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let (Some(run), Some(chosen)) = (retrainable_run(opened), self.training.scene.scale) else {
            return;
        };
        if snapshot.state == RunState::Ready && run.scale != chosen {
            self.view.retain_camera_for(opened);
            self.worker.send(WorkerOrder::Reset);
        }
    }
}
