//! Frame strip at the bottom, and camera previews by dragging over it.

use super::Studio;
use crate::app::frame_outcomes::FrameOutcomes;
use crate::app::panels::frame_strip;
use crate::app::panels::frame_strip::{StripAnswer, StripContext, StripPosition};
use crate::app::state::{RunState, Snapshot};
use crate::app::viewer::viewpoint::Place;
use eframe::egui::{Frame, Panel, Ui};

/// Initial and largest share of the window's height for the strip.
const SHARE: f32 = 0.16;
const MAX_SHARE: f32 = 0.4;

impl Studio {
    /// Draws the strip if a dataset is open.
    pub(super) fn frame_strip(&mut self, ui: &mut Ui, frame: Frame, snapshot: &Snapshot) {
        let Some(opened) = snapshot.opened.as_ref().filter(|opened| opened.dataset.is_some())
        else {
            return;
        };
        self.strip.outcomes.update(snapshot);
        let shown = self.view.camera.frame_ref().cloned();
        let is_open = self.layout.shows_frames;
        let thumbnails = self.view.thumbnails(opened);
        if let Some(thumbnails) = &thumbnails {
            thumbnails.set_yields_cores(snapshot.state == RunState::Training);
        }
        let context = StripContext {
            snapshot,
            opened,
            outcomes: &self.strip.outcomes,
            quality: &self.quality,
            shown: shown.as_ref(),
        };
        let position = &mut self.strip.position;
        let asked = if is_open {
            let room = ui.max_rect().height();
            let heights = frame_strip::HEIGHTS;
            let highest = (MAX_SHARE * room).clamp(heights.min, heights.max);
            let panel = Panel::bottom("frames").frame(frame).resizable(true);
            let panel = panel
                .size_range(heights.min..=highest)
                .default_size((SHARE * room).clamp(heights.min, highest));
            panel.show(ui, |ui| {
                let folded = frame_strip::header(&context, is_open, ui);
                frame_strip::ui(&context, position, thumbnails, ui).or(folded)
            })
        } else {
            let panel = Panel::bottom("frames folded").frame(frame);
            panel.show(ui, |ui| frame_strip::header(&context, is_open, ui))
        };
        self.answer_strip(asked.inner, opened.serial, ui);
    }

    fn answer_strip(&mut self, asked: Option<StripAnswer>, serial: u64, ui: &Ui) {
        match asked {
            None => {}
            Some(StripAnswer::Fold) => self.layout.shows_frames = !self.layout.shows_frames,
            Some(StripAnswer::Show(frame)) => self.view.camera.move_to_frame(frame),
            Some(StripAnswer::Preview(frame)) => {
                if self.strip.before.is_none() {
                    self.strip.before = Some((serial, self.view.camera.place()));
                }
                if self.view.camera.frame_ref() != Some(&frame) {
                    self.view.camera.move_to_frame(frame);
                }
            }
        }
        if ui.input(|i| i.pointer.any_down()) {
            return;
        }
        // If another dataset was opened during the drag, the previous camera no longer applies.
        if let Some((_, before)) = self.strip.before.take().filter(|(was, _)| *was == serial) {
            self.view.camera.return_to(before);
        }
    }
}

/// State of the frame strip for the open dataset.
#[derive(Default)]
pub(super) struct FrameStripState {
    pub(super) outcomes: FrameOutcomes,
    pub(super) position: StripPosition,
    /// Serial of the open dataset and view before a preview began.
    pub(super) before: Option<(u64, Place)>,
}
