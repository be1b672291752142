//! View state that outlives its window: camera, comparison and edits. The rest depends on the graphics
//! device or can be recomputed.

use super::SceneView;
use super::compared_model::ModelSlot;
use super::measure::MeasureTool;
use super::mode::ViewMode;
use super::stand::{GuideStage, ViewPosition};
use crate::app::camera::ViewCamera;
use crate::app::edit::editor::Editor;

/// View state that the next window restores if the same subject is open.
pub struct KeptView {
    serial: u64,
    camera: Option<ViewCamera>,
    place: ViewPosition,
    guide: Option<GuideStage>,
    mode: ViewMode,
    divider: f32,
    compared: ModelSlot,
    measure: MeasureTool,
    editor: Editor,
}

impl SceneView {
    /// Moves the state for the next window out of this view.
    pub fn take_retained_state(&mut self) -> KeptView {
        // The export dialog closes with the window, so its preview ends too.
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

    /// Restores the state of the previous window; it is reset once another subject is open.
    pub fn restore_retained_state(&mut self, kept: KeptView) {
        let KeptView { serial, camera, place, guide, mode, divider, compared, measure, editor } =
            kept;
        (self.serial, self.camera, self.place, self.guide) = (serial, camera, place, guide);
        (self.mode, self.divider, self.compared, self.measure) = (mode, divider, compared, measure);
        self.editor = editor.without_scene();
    }
}
