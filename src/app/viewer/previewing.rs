//! The preview of an export in the view: turned to when it is there, left when it is over.

use super::SceneView;
use super::export_preview::{ExportChoice, ExportPreview, PreviewReport};
use super::mode::ViewMode;
use super::picture_request::PictureRequest;
use crate::app::state::{Opened, RunState};
use std::time::Instant;

impl SceneView {
    /// Shows beside the scene what a file would give back of it, from now on; `None` ends that.
    ///
    /// # Errors
    /// No thread could be started.
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
        self.preview.choose(choice, self.palette.learned(), frame, is_training, &self.waker)
    }

    /// What is known of the file that is previewed, if one is.
    pub fn previewed(&self) -> Option<PreviewReport> {
        self.preview.told()
    }

    /// Takes what was converted since, and turns to it at first.
    pub(super) fn take_preview(&mut self) {
        if self.preview.take() && self.preview.before.is_none() {
            self.preview.before = Some(self.mode);
            self.mode = ViewMode::ModelWipe;
        }
    }

    /// Asks for the figure of a view that rests.
    pub(super) fn measure_preview(&mut self, request: &PictureRequest, state: RunState) {
        if self.moved_at.elapsed() < super::SETTLE {
            return;
        }
        let is_training = state == RunState::Training;
        if let Err(error) = self.preview.measure(request, is_training, &self.waker) {
            self.hint = Some((format!("No thread to measure on: {error}"), Instant::now()));
        }
    }

    /// Compares again with what was compared with before.
    pub(super) fn end_preview(&mut self) {
        let ExportPreview { before, .. } = std::mem::take(&mut self.preview);
        if let Some(before) = before.filter(|_| self.mode.has_model()) {
            self.mode = before;
        }
    }
}
