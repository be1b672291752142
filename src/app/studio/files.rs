//! Opening and writing files, and the actions that wait for them.

use super::Studio;
use super::commands::order_to_open;
use crate::app::abandoned::AbandonedRun;
use crate::app::command::UiCommand;
use crate::app::film::FilmRequest;
use crate::app::opening::{AfterWrite, Continuation, Pending};
use crate::app::panels::status::Answer;
use crate::app::path_dialog::PathAnswer;
use crate::app::state::{NoticeKind, RunState, Snapshot};
use crate::app::viewer::export_preview::ExportChoice;
use crate::app::worker::WorkerOrder;
use crate::app::{export_options, panels};
use crate::export::ModelFormat;
use crate::render::{Lens, RenderOptions};
use eframe::egui::{
    Grid, Id, Modal, ProgressBar, RichText, ScrollArea, Ui, ViewportCommand, Window,
};

impl Studio {
    /// Sends the order at once if no training would be lost, otherwise after confirmation.
    pub(super) fn confirm_then_send(&mut self, order: WorkerOrder, snapshot: &Snapshot) {
        self.pending = match self.pending.take() {
            // The user already confirmed or is about to name a file; only the following action changes.
            Some(waiting) => Some(waiting.instead(Continuation::Send(order))),
            None if snapshot.has_training_to_lose() => {
                Some(Pending::Asking(Continuation::Send(order)))
            }
            None => {
                self.worker.send(order);
                None
            }
        };
    }

    /// True if the user chose "Not now" for this abandoned run.
    pub(super) fn is_postponed(&self, run: &AbandonedRun) -> bool {
        self.postponed_slot.as_ref() == Some(&run.slot)
    }

    pub(super) fn handle_abandoned_answer(
        &mut self,
        run: &AbandonedRun,
        answer: Option<Answer>,
        snapshot: &Snapshot,
    ) {
        match answer {
            None => {}
            Some(Answer::Resume) => self.confirm_then_send(WorkerOrder::ResumeAbandoned, snapshot),
            Some(Answer::Forget) => self.worker.send(WorkerOrder::DiscardAbandoned),
            Some(Answer::NotNow) => self.postponed_slot = Some(run.slot.clone()),
        }
    }

    pub(super) fn dialogs(&mut self, ui: &Ui, snapshot: &Snapshot) {
        // No action waits for this dialog, so cancelling it has no effect.
        if let Some(PathAnswer::Path(path)) =
            self.open_dialog.ui(ui, self.window_waker.waker(), |_| (), |_| ())
        {
            self.confirm_then_send(order_to_open(path), snapshot);
        }
        if let Some(PathAnswer::Path(path)) =
            self.compare_dialog.ui(ui, self.window_waker.waker(), |_| (), |_| ())
            && let Err(error) = self.view.compare_with(path)
        {
            let text = format!("cannot start a thread to read the model: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
        match self.save_dialog.ui(ui, self.window_waker.waker(), |_| (), |_| ()) {
            None => {}
            Some(PathAnswer::Cancelled) => self.cancel_naming(),
            Some(PathAnswer::Path(path)) => {
                let number = self.begin_write();
                self.worker.send(WorkerOrder::Save(number, path));
            }
        }
        self.ask_export(ui, snapshot);
        self.ask_film(ui, snapshot);
        if let Some((kind, text)) = self.still.take() {
            self.worker.send(WorkerOrder::Report(kind, text));
        }
        help(ui, &mut self.help_is_open);
        let mut finder = std::mem::take(&mut self.finder);
        let chosen = finder.ui(ui, |action| self.unavailable_reason(action, snapshot).is_none());
        self.finder = finder;
        if let Some(action) = chosen {
            self.apply_action(action, snapshot);
        }
        // After the dialogs, so that a file named in this pass is already taken into account.
        self.resolve_pending(ui, snapshot);
    }

    /// Draws the export dialog with its options and preview.
    fn ask_export(&mut self, ui: &Ui, snapshot: &Snapshot) {
        self.preview_export(snapshot);
        let is_native = snapshot.opened.as_ref().is_some_and(|opened| opened.is_native);
        let left_out = match self.export_dialog.is_open() {
            true => self.view.n_left_out(),
            false => None,
        };
        let report = self.view.comparison.export_preview_report();
        let (mapping, previews) = (&mut self.mapping, &mut self.view.settings.previews_export);
        let choices = |ui: &mut Ui| {
            if is_native {
                export_options::ui(mapping, ui);
            }
            if let Some((n, all)) = left_out {
                ui.label(format!("{n} of {all} splats are excluded by edits (Edit tab)."));
            }
            export_options::preview(previews, ui);
        };
        let told = |ui: &mut Ui| export_options::report(report.as_ref(), ui);
        match self.export_dialog.ui(ui, self.window_waker.waker(), choices, told) {
            None => {}
            Some(PathAnswer::Cancelled) => self.cancel_naming(),
            Some(PathAnswer::Path(path)) => {
                let number = self.begin_write();
                let left_out = self.view.editor().left_out();
                self.worker.send(WorkerOrder::Export(number, path, self.mapping, left_out));
            }
        }
    }

    /// Saves the current view as a PNG next to the open file or folder.
    pub(super) fn save_picture(&mut self, snapshot: &Snapshot) {
        let (Some(opened), Some(still)) = (&snapshot.opened, self.view.still()) else { return };
        let path = opened.files.path("view.png");
        if let Err(error) = self.still.start(still, path, self.window_waker.waker().clone()) {
            let text = format!("cannot start a thread to draw the picture: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
    }

    /// Draws the film dialog and reports the previous film.
    fn ask_film(&mut self, ui: &Ui, snapshot: &Snapshot) {
        if let Some((kind, text)) = self.film.poll_notice() {
            self.worker.send(WorkerOrder::Report(kind, text));
        }
        let path = &mut self.path;
        let choices = |ui: &mut Ui| panels::path::film_choices(path, ui);
        let Some(PathAnswer::Path(output)) =
            self.film_dialog.ui(ui, self.window_waker.waker(), choices, |_| ())
        else {
            return;
        };
        let (Some(opened), Some(path)) = (&snapshot.opened, self.path.paced()) else { return };
        let settings = &self.view.settings;
        let method = settings.method(settings.renderer, Lens::Pinhole);
        let plain = RenderOptions::viewport(method, settings.background.rgb(), opened.home.radius);
        let order = FilmRequest {
            path,
            size: self.path.size,
            output,
            options: RenderOptions { exposure_mode: settings.exposing, ..plain },
            left_out: self.view.editor().left_out(),
            is_beside_training: snapshot.state == RunState::Training,
        };
        let scene = self.view.learned().clone();
        if let Err(error) = self.film.start(scene, order, self.window_waker.waker().clone()) {
            let text = format!("cannot start a thread to render the film: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
    }

    /// Previews the choices of the export dialog while it is open.
    fn preview_export(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let is_wanted = self.export_dialog.is_open() && self.view.settings.previews_export;
        let format = is_wanted.then(|| ModelFormat::from_path(&self.export_dialog.entered()).ok());
        let choice = format.flatten().map(|format| ExportChoice {
            format,
            mapping: self.mapping,
            left_out: self.view.editor().left_out(),
        });
        if let Err(error) = self.view.preview_export(choice, opened, snapshot.state) {
            let text = format!("cannot start a thread to preview the file: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
            self.view.settings.previews_export = false;
        }
    }

    /// Returns a number for the next file and makes the pending action wait for it.
    fn begin_write(&mut self) -> u64 {
        // A number, not the path: the snapshot may still report an earlier file of the same name.
        let number = self.worker.new_number();
        self.pending = self.pending.take().map(|pending| pending.named(number));
        number
    }

    /// Cancels the action that waits for a file name.
    fn cancel_naming(&mut self) {
        self.pending = self.pending.take().filter(|p| !matches!(p, Pending::Naming(_)));
    }

    /// Confirms discarding of unsaved training and executes pending actions that are ready.
    fn resolve_pending(&mut self, ui: &Ui, snapshot: &Snapshot) {
        // Taken out and put back while waiting, since dialogs are drawn in every pass.
        let Some(pending) = self.pending.take() else { return };
        match pending.after(snapshot.latest_write) {
            AfterWrite::Wait(Pending::Asking(next)) => {
                self.confirm_pending(next, ui, snapshot.unsaved_frames)
            }
            AfterWrite::Wait(waiting) => {
                let exported = self.worker.file_progress();
                let is_given_up =
                    matches!(waiting, Pending::Writing(..)) && writing_dialog(ui, exported);
                if is_given_up && exported.is_some() {
                    self.worker.cancel_file();
                }
                self.pending = Some(waiting).filter(|_| !is_given_up);
            }
            AfterWrite::GoAhead(next) => self.execute(next, ui),
            AfterWrite::GiveUp => {}
        }
    }

    fn confirm_pending(&mut self, next: Continuation, ui: &Ui, n_frames: usize) {
        match confirm_discard(ui, n_frames) {
            None => self.pending = Some(Pending::Asking(next)),
            Some(Decision::Discard) => self.execute(next, ui),
            Some(Decision::Save) => {
                self.pending = Some(Pending::Naming(next));
                self.save_dialog.show();
            }
            Some(Decision::Export) => {
                self.pending = Some(Pending::Naming(next));
                self.export_dialog.show();
            }
            Some(Decision::Cancel) => {}
        }
    }

    fn execute(&mut self, next: Continuation, ui: &Ui) {
        match next {
            Continuation::Send(order) => self.worker.send(order),
            Continuation::Close => {
                // The command returns as a close request, which must not be confirmed again.
                self.may_close = true;
                ui.ctx().send_viewport_cmd(ViewportCommand::Close);
            }
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    Discard,
    Save,
    Export,
    Cancel,
}

/// Confirms that `n_frames` of unsaved training may be discarded; `None` until the user decides.
pub fn confirm_discard(ui: &Ui, n_frames: usize) -> Option<Decision> {
    let mut decision = None;
    let response = Modal::new(Id::unique("discard")).show(ui.ctx(), |ui| {
        ui.heading("Discard the trained scene?");
        ui.label(format!("{n_frames} trained frames are neither saved nor exported."));
        ui.add_space(8.0);
        ui.horizontal(|ui| {
            for (label, choice) in [
                ("Save first…", Decision::Save),
                ("Export first…", Decision::Export),
                ("Discard", Decision::Discard),
                ("Cancel", Decision::Cancel),
            ] {
                if ui.button(label).clicked() {
                    decision = Some(choice);
                }
            }
        });
    });
    if response.should_close() {
        decision = decision.or(Some(Decision::Cancel));
    }
    decision
}

/// Shows a progress dialog while an action waits for a file; `exported` is the share of an export already
/// written. Returns true if the user cancels.
pub fn writing_dialog(ui: &Ui, exported: Option<f32>) -> bool {
    let response = Modal::new(Id::unique("writing")).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("Writing the file…");
        });
        ui.add_space(8.0);
        if let Some(share) = exported {
            ui.add(ProgressBar::new(share).show_percentage());
        }
        // Saving a checkpoint is faster than a click, so it cannot be cancelled.
        let meaning = match exported {
            Some(_) => "Stops the export; the pending action is cancelled too",
            None => "The file is still written; the pending action is cancelled",
        };
        ui.button("Cancel").on_hover_text(meaning).clicked()
    });
    response.inner || response.should_close()
}

/// Mouse and keyboard actions that are not commands.
const MOUSE: [(&str, &str); 8] = [
    ("Left drag", "Orbit"),
    ("Right or middle drag", "Pan"),
    ("Wheel, pinch", "Dolly"),
    ("Double click", "Orbit about this point of the surface"),
    ("W A S D, Q E", "Fly; Q and E: down and up. Shift: 10× faster, Ctrl: 10× slower"),
    ("Drag a divider", "Wipe between the two pictures"),
    ("Shift+Tab", "Focus the controls; Tab for the next, Escape back to the view"),
    ("Drop a folder or file", "Open it, or apply a calibration to the open dataset"),
];

/// Height of the help window's title bar and margins, points.
const HELP_FRAME: f32 = 60.0;

pub fn help(ui: &Ui, is_open: &mut bool) {
    let room = ui.ctx().viewport_rect().height() - HELP_FRAME;
    Window::new("Shortcuts").open(is_open).collapsible(false).resizable(false).show(
        ui.ctx(),
        |ui| {
            // The list uses the whole height of the window if it needs to.
            let list = ScrollArea::vertical().max_height(room).min_scrolled_height(room);
            list.show(ui, shortcuts);
        },
    );
}

fn shortcuts(ui: &mut Ui) {
    Grid::new("shortcuts").num_columns(2).striped(true).show(ui, |ui| {
        for command in UiCommand::ALL {
            if !command.shortcuts().is_empty() {
                ui.label(RichText::new(command.keys(ui.ctx())).monospace());
                ui.label(command.tooltip());
                ui.end_row();
            }
        }
        for (action, effect) in MOUSE {
            ui.label(RichText::new(action).monospace());
            ui.label(effect);
            ui.end_row();
        }
    });
}
