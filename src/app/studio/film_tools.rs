//! Camera path with its playback, and pictures and films drawn by other threads.

use crate::app::film::{FilmThread, StillJob};
use crate::app::panels::path;
use crate::app::panels::path::PathRequest;
use crate::app::path_dialog::PathDialog;
use crate::app::path_editor::PathEditor;
use crate::app::state::{NoticeKind, Opened};
use crate::app::viewer::SceneView;
use crate::app::worker::{Worker, WorkerOrder};
use eframe::egui::Ui;

#[derive(Default)]
pub(super) struct FilmTools {
    pub path: PathEditor,
    /// True if the viewport shows the playback position of the camera path.
    is_at_moment: bool,
    pub thread: FilmThread,
    pub still: StillJob,
    /// Width and height of the next picture, pixels.
    pub still_size: [u32; 2],
}

impl FilmTools {
    pub fn panel(
        &mut self,
        view: &mut SceneView,
        dialog: &mut PathDialog,
        worker: &Worker,
        opened: &Opened,
        ui: &mut Ui,
    ) {
        let file = opened.files.path("path.json");
        match path::ui(&mut self.path, view, &file, self.thread.share(), ui) {
            None => {}
            Some(PathRequest::Film) => dialog.show(),
            Some(PathRequest::CancelFilm) => self.thread.cancel(),
            Some(PathRequest::Save(json)) => worker.send(WorkerOrder::WriteText(file, json)),
            Some(PathRequest::Open(file)) => {
                if let Err(error) = self.path.open(&file, view.camera.up()) {
                    worker.send(WorkerOrder::Report(NoticeKind::Error, error.to_string()));
                }
            }
        }
    }

    /// Advances the playback of a camera path and moves the view. Playback stops if the user moves the
    /// camera.
    pub fn play(&mut self, view: &mut SceneView, ui: &Ui) {
        if !self.path.is_playing {
            self.is_at_moment = false;
            return;
        }
        if self.is_at_moment && !view.camera.is_along() {
            (self.path.is_playing, self.is_at_moment) = (false, false);
            return;
        }
        // The first pass shows the moment at which the path was stopped.
        let seconds = if self.is_at_moment { f64::from(ui.input(|i| i.stable_dt)) } else { 0.0 };
        match self.path.advance(seconds) {
            Some(moment) => view.move_to_keyframe(moment),
            None => self.path.is_playing = false,
        }
        self.is_at_moment = true;
        // Without input, egui would not draw the next moment.
        ui.ctx().request_repaint();
    }
}
