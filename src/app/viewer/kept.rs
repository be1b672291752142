//! What of the view outlives its window: where one stands, what is compared and what was edited. The rest is
//! made of a graphics device, or is found again.

use super::SceneView;
use super::compared_model::ModelSlot;
use super::measure::MeasureTool;
use super::mode::ViewMode;
use super::stand::{GuideStage, Place};
use crate::app::camera::ViewCamera;
use crate::app::edit::editor::Editor;

/// What the next window's view goes on with, as long as the same is open.
pub struct KeptView {
    serial: u64,
    camera: Option<ViewCamera>,
    place: Place,
    guide: Option<GuideStage>,
    mode: ViewMode,
    divider: f32,
    compared: ModelSlot,
    measure: MeasureTool,
    editor: Editor,
}

impl SceneView {
    /// Lets go of what the next window goes on with.
    pub fn keep(&mut self) -> KeptView {
        // The dialog that it belongs to goes down with the window.
        self.end_preview();
        KeptView {
            serial: self.serial,
            camera: self.camera,
            place: self.place.clone(),
            guide: self.guide,
            mode: self.mode,
            divider: self.divider,
            compared: std::mem::take(&mut self.compared),
            measure: std::mem::take(&mut self.measure),
            editor: std::mem::take(&mut self.editor),
        }
    }

    /// Goes on with what the window before has kept, until something else is open.
    pub fn go_on_with(&mut self, kept: KeptView) {
        let KeptView { serial, camera, place, guide, mode, divider, compared, measure, editor } =
            kept;
        (self.serial, self.camera, self.place, self.guide) = (serial, camera, place, guide);
        (self.mode, self.divider, self.compared, self.measure) = (mode, divider, compared, measure);
        self.editor = editor.without_scene();
    }
}
