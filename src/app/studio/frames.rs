//! Frame strip at the bottom, and camera previews by dragging over it.

use crate::app::frame_outcomes::FrameOutcomes;
use crate::app::panels::frame_strip;
use crate::app::panels::frame_strip::{ScrolledTo, StripAnswer, StripContext};
use crate::app::quality::QualityMonitor;
use crate::app::state::{Opened, RunState, Snapshot};
use crate::app::viewer::SceneView;
use crate::app::viewer::thumbnails::TrainedThumbnails;
use crate::app::viewer::viewpoint::Place;
use eframe::egui::{Frame, Panel, Ui};

/// Initial and maximum height of the frame strip, as fractions of the window's height.
const SHARE: f32 = 0.16;
const MAX_SHARE: f32 = 0.4;

#[derive(Default)]
pub(super) struct FrameStripState {
    outcomes: FrameOutcomes,
    scrolled_to: ScrolledTo,
    /// Serial number of the open dataset, and the view before a preview began.
    before: Option<(u64, Place)>,
}

impl FrameStripState {
    /// Draws the frame strip if a dataset is open. `trained` has the pictures of frames that training has
    /// decoded.
    pub fn ui(
        &mut self,
        view: &mut SceneView,
        quality: &QualityMonitor,
        is_open: bool,
        frame: Frame,
        (snapshot, trained): (&Snapshot, &TrainedThumbnails),
        ui: &mut Ui,
    ) {
        let Some(opened) = snapshot.opened.as_ref().filter(|opened| opened.dataset.is_some())
        else {
            return;
        };
        self.outcomes.update(snapshot);
        let shown = view.camera.frame_ref().cloned();
        let editor = view.editor();
        let moments: Vec<usize> =
            editor.stored_scenes.moments().iter().map(|moment| moment.after.n_seen).collect();
        let earlier = editor.displayed_past().map(|past| past.after.n_seen);
        let mut thumbnails = view.thumbnails(opened);
        if let Some(thumbnails) = &mut thumbnails {
            thumbnails.set_yields_cores(snapshot.state == RunState::Training);
            thumbnails.take_trained(ui.ctx(), opened, trained);
        }
        let context = StripContext {
            snapshot,
            opened,
            outcomes: &self.outcomes,
            quality,
            shown: shown.as_ref(),
            moments: &moments,
            earlier,
        };
        let scrolled_to = &mut self.scrolled_to;
        let asked = if is_open {
            let room = ui.max_rect().height();
            let heights = frame_strip::HEIGHTS;
            let highest = (MAX_SHARE * room).clamp(heights.min, heights.max);
            let panel = Panel::bottom("frames").frame(frame).resizable(true);
            let panel = panel
                .size_range(heights.min..=highest)
                .default_size((SHARE * room).clamp(heights.min, highest));
            panel.show(ui, |ui| {
                let stepped = frame_strip::header(&context, ui);
                frame_strip::ui(&context, scrolled_to, thumbnails, ui).or(stepped)
            })
        } else {
            // Another name, because egui stores the size of the open strip by its name.
            let panel = Panel::bottom("frames folded").frame(frame);
            panel.show(ui, |ui| frame_strip::header(&context, ui))
        };
        self.follow_preview(asked.inner, opened, view, ui);
    }

    fn follow_preview(
        &mut self,
        asked: Option<StripAnswer>,
        opened: &Opened,
        view: &mut SceneView,
        ui: &Ui,
    ) {
        match asked {
            None => {}
            Some(StripAnswer::Step(direction)) => view.camera.step(opened, direction),
            Some(StripAnswer::WalkBack(n_frames)) => view.editor.earlier_frames = n_frames,
            Some(StripAnswer::Show(frame)) => view.camera.move_to_frame(frame),
            Some(StripAnswer::Preview(frame)) => {
                if self.before.is_none() {
                    self.before = Some((opened.serial, view.camera.place()));
                }
                if view.camera.frame_ref() != Some(&frame) {
                    view.camera.move_to_frame(frame);
                }
            }
        }
        // A preview lasts until the button is released.
        if ui.input(|i| i.pointer.any_down()) {
            return;
        }
        // If another dataset was opened during the drag, the previous camera no longer applies.
        if let Some((_, before)) = self.before.take().filter(|(was, _)| *was == opened.serial) {
            view.camera.return_to(before);
        }
    }
}
