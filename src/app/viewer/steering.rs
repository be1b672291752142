//! The pointer on the viewport: orbit, pan, dolly.

use super::{Place, SceneView};
use crate::app::state::Opened;
use eframe::egui::{PointerButton, Response, Ui};
use std::time::Instant;

/// What the pointer asks for in one frame, in points.
struct Gesture {
    turn: [f64; 2],
    pan: [f64; 2],
    dolly: f64,
}

impl Gesture {
    fn read(ui: &Ui, response: &Response) -> Self {
        let delta = response.drag_delta();
        let delta = [f64::from(delta.x), f64::from(delta.y)];
        let is_turn = response.dragged_by(PointerButton::Primary);
        let is_pan = response.dragged_by(PointerButton::Secondary)
            || response.dragged_by(PointerButton::Middle);
        // Over a panel the wheel scrolls the panel.
        let dolly = if response.hovered() {
            let (wheel, zoom) = ui.input(|i| (i.smooth_scroll_delta.y, i.zoom_delta()));
            // A pinch by a factor moves closer by that factor: the camera halves its distance every
            // 240 points of the wheel.
            f64::from(wheel) + 240.0 * f64::from(zoom).log2()
        } else {
            0.0
        };
        Self {
            turn: if is_turn { delta } else { [0.0; 2] },
            pan: if is_pan && !is_turn { delta } else { [0.0; 2] },
            dolly,
        }
    }

    fn is_nothing(&self) -> bool {
        self.turn == [0.0; 2] && self.pan == [0.0; 2] && self.dolly == 0.0
    }
}

impl SceneView {
    /// Moves the camera as the pointer asks; from a dataset's camera it starts where that stood.
    pub(super) fn steer(
        &mut self,
        ui: &Ui,
        response: &Response,
        opened: &Opened,
        size_px: [u32; 2],
    ) {
        let gesture = Gesture::read(ui, response);
        if gesture.is_nothing() {
            return;
        }
        if let Some((stood, _)) = self.camera_now(opened, size_px)
            && let (Place::At(_), Some(camera)) = (&self.place, &mut self.camera)
        {
            camera.visit(&stood);
            self.place = Place::Free;
        }
        let Some(camera) = &mut self.camera else { return };
        let size = response.rect.size();
        let size = [f64::from(size.x), f64::from(size.y)];
        camera.turn(gesture.turn, size[1]);
        camera.pan(gesture.pan, size);
        camera.dolly(gesture.dolly);
        self.moved_at = Instant::now();
    }
}
