//! Starts and ends the preview of an export in the view.

use super::SceneView;
use super::export_preview::{ExportChoice, ExportPreview, PreviewReport};
use super::mode::ViewMode;
use super::picture_request::PictureRequest;
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
