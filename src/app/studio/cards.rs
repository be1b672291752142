//! What lies over the viewport when something has just been opened or finished.

use super::{Studio, Tab};
use crate::app::color_mode::ColorMode;
use crate::app::panels::ready;
use crate::app::panels::summary::{self, SummaryAnswer};
use crate::app::state::{Opened, RunState, Snapshot, Source};
use crate::app::training::TrainSettings;
use crate::app::viewer::frame_refs::FrameRef;
use crate::app::viewer::mode::ViewMode;
use crate::app::worker::WorkerOrder;
use crate::train::scene::units::StructuralScale;
use eframe::egui::{Pos2, Ui, Vec2};

/// Distance of cards from the edge of the viewport, points.
const MARGIN: Vec2 = Vec2::new(12.0, -12.0);
/// What the structural scale of a finer run is of this one's: twice as many components, for their number
/// goes with the square.
const FINER: f64 = std::f64::consts::FRAC_1_SQRT_2;

impl Studio {
    /// The card that goes with the state, if one does.
    pub(super) fn cards(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let corner = ui.max_rect().left_bottom() + MARGIN;
        if snapshot.state == RunState::Ready && snapshot.frames_done == 0 {
            self.ready_card(opened, corner, ui, snapshot);
        }
        let is_read = self.summary_closed == opened.serial;
        let is_plain = self.view.mode() == ViewMode::Single
            && self.view.settings.color_mode == ColorMode::Color;
        let is_done = snapshot.state == RunState::Finished && snapshot.source == Source::Dataset;
        if is_done && is_plain && !is_read {
            self.summary_card(opened, corner, ui, snapshot);
        }
    }

    fn ready_card(&mut self, opened: &Opened, corner: Pos2, ui: &Ui, snapshot: &Snapshot) {
        let first = FrameRef::trained(opened, 0);
        let photo = match (self.view.thumbnails(opened), &first) {
            (Some(thumbnails), Some(first)) => thumbnails.get(ui.ctx(), first, true),
            _ => None,
        };
        if let Some(command) = ready::ui(snapshot, opened, photo, corner, ui) {
            self.apply_command(command, snapshot);
        }
    }

    fn summary_card(&mut self, opened: &Opened, corner: Pos2, ui: &Ui, snapshot: &Snapshot) {
        let finer = finer(&self.training, opened);
        let forecast = finer.as_ref().map(|(_, pixels)| {
            let components = (snapshot.used as f64 / (FINER * FINER)).round();
            format!(
                "The same frames again with a structural scale of {pixels:.2} pixels: some {components} components. The view stays"
            )
        });
        match summary::ui(snapshot, &self.quality, forecast.as_deref(), corner, ui) {
            None => {}
            Some(SummaryAnswer::Close) => self.summary_closed = opened.serial,
            Some(SummaryAnswer::Quality) => self.tab = Tab::Quality,
            Some(SummaryAnswer::Command(command)) => self.apply_command(command, snapshot),
            Some(SummaryAnswer::Finer) => {
                let Some((settings, _)) = finer else { return };
                self.training = settings.clone();
                self.view.keep_place_of(opened);
                self.discard_then(WorkerOrder::Retrain(Box::new(settings)), snapshot);
            }
        }
    }
}

/// The settings of a finer run and its structural scale, pixels; `None` where the preset has none or
/// it is given in world units.
fn finer(training: &TrainSettings, opened: &Opened) -> Option<(TrainSettings, f64)> {
    let StructuralScale::Pixels(pixels) = opened.scene()?.scale else { return None };
    let mut settings = training.clone();
    settings.scene.scale = Some(StructuralScale::Pixels(FINER * pixels));
    Some((settings, FINER * pixels))
}
