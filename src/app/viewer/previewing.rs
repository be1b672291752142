//! Starts and ends the preview of an export in the view.

use super::SceneView;
use super::comparison::ModelSlot;
use super::export_preview::{ExportChoice, ExportPreview, PreviewReport};
use super::frame_refs::FrameRef;
use super::measure::MeasureTool;
use super::photo::PictureRequest;
use super::steering::{GuideStage, ViewPosition};
use super::toolbar::ViewMode;
use crate::app::camera::ViewCamera;
use crate::app::edit::editor::Editor;
use crate::app::state::{Opened, RunState};
use std::time::Instant;

impl SceneView {
    /// Previews an export beside the scene; `None` ends the preview.
    ///
    /// # Errors
    /// If no thread can be started.
    pub fn preview_export(
        &mut self,
        choice: Option<ExportChoice>,
        opened: &Opened,
        state: RunState,
    ) -> std::io::Result<()> {
        let Some(choice) = choice else {
            self.end_preview();
            return Ok(());
        };
        let frame = (opened.home.up, opened.local_origin);
        let is_training = state == RunState::Training;
        self.preview.request_conversion(
            choice,
            self.palette.learned(),
            frame,
            is_training,
            &self.waker,
        )
    }

    /// State of the export preview, if there is one.
    pub fn export_preview_report(&self) -> Option<PreviewReport> {
        self.preview.current_report()
    }

    /// Takes a finished conversion, and switches the mode to the first one.
    pub(super) fn take_preview(&mut self) {
        if self.preview.take_finished_jobs() && self.preview.before.is_none() {
            self.preview.before = Some(self.mode);
            self.mode = ViewMode::ModelWipe;
        }
    }

    /// Starts to measure the preview once the view rests.
    pub(super) fn measure_preview(&mut self, request: &PictureRequest, state: RunState) {
        if self.moved_at.elapsed() < super::SETTLE {
            return;
        }
        let is_training = state == RunState::Training;
        if let Err(error) = self.preview.measure(request, is_training, &self.waker) {
            self.hint = Some((
                format!("Starting the thread that measures the preview failed: {error}"),
                Instant::now(),
            ));
        }
    }

    /// Ends the preview and restores the previous mode.
    pub(super) fn end_preview(&mut self) {
        let ExportPreview { before, .. } = std::mem::take(&mut self.preview);
        if let Some(before) = before.filter(|_| self.mode.has_model()) {
            self.mode = before;
        }
    }
}

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

/// Position before a temporary visit.
pub struct SavedPosition {
    place: ViewPosition,
    guide: Option<GuideStage>,
    latest_frame: Option<FrameRef>,
}

impl SceneView {
    /// Current position, to return to.
    pub fn current_position(&self) -> SavedPosition {
        SavedPosition {
            place: self.place.clone(),
            guide: self.guide,
            latest_frame: self.latest_frame.clone(),
        }
    }

    /// Restores a position.
    pub fn restore_position(&mut self, before: SavedPosition) {
        let SavedPosition { place, guide, latest_frame } = before;
        (self.place, self.guide, self.latest_frame) = (place, guide, latest_frame);
        self.moved_at = Instant::now();
    }
}
