//! Files that are opened and written, and what waits for them.

use super::Studio;
use super::commands::order_to_open;
use crate::app::abandoned::AbandonedRun;
use crate::app::dialogs::{self, Decision};
use crate::app::export_options;
use crate::app::film::FilmOrder;
use crate::app::panels;
use crate::app::panels::abandoned::Answer;
use crate::app::path_dialog::PathAnswer;
use crate::app::pending::{AfterWrite, Continuation, Pending};
use crate::app::state::{NoticeKind, RunState, Snapshot};
use crate::app::viewer::export_preview::ExportChoice;
use crate::app::worker::WorkerOrder;
use crate::export::ModelFormat;
use crate::render::{Lens, RenderOptions};
use eframe::egui::{Ui, ViewportCommand};

impl Studio {
    /// Goes ahead at once if nothing would be lost, else asks.
    pub(super) fn discard_then(&mut self, order: WorkerOrder, snapshot: &Snapshot) {
        self.pending = match self.pending.take() {
            // The user has been asked about this training, and may have named a file.
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

    /// Whether the user wants to be asked about an abandoned run another time.
    pub(super) fn is_put_off(&self, run: &AbandonedRun) -> bool {
        self.put_off.as_ref() == Some(&run.slot)
    }

    pub(super) fn answer_abandoned(
        &mut self,
        run: &AbandonedRun,
        answer: Option<Answer>,
        snapshot: &Snapshot,
    ) {
        match answer {
            None => {}
            Some(Answer::GoOn) => self.discard_then(WorkerOrder::GoOn, snapshot),
            Some(Answer::GiveUp) => self.worker.send(WorkerOrder::GiveUp),
            Some(Answer::NotNow) => self.put_off = Some(run.slot.clone()),
        }
    }

    pub(super) fn dialogs(&mut self, ui: &Ui, snapshot: &Snapshot) {
        // Nothing ever waits for this dialog, so it does not matter that it was cancelled.
        if let Some(PathAnswer::Path(path)) =
            self.open_dialog.ui(ui, self.wakes.waker(), |_| (), |_| ())
        {
            self.discard_then(order_to_open(path), snapshot);
        }
        if let Some(PathAnswer::Path(path)) =
            self.compare_dialog.ui(ui, self.wakes.waker(), |_| (), |_| ())
            && let Err(error) = self.view.compare_with(path)
        {
            let text = format!("no thread to read a model on could be started: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
        match self.save_dialog.ui(ui, self.wakes.waker(), |_| (), |_| ()) {
            None => {}
            Some(PathAnswer::Cancelled) => self.forget_named(),
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
        dialogs::help(ui, &mut self.help_is_open);
        let mut finder = std::mem::take(&mut self.finder);
        let chosen = finder.ui(ui, |action| self.why_not(action, snapshot).is_none());
        self.finder = finder;
        if let Some(action) = chosen {
            self.apply_action(action, snapshot);
        }
        // After the dialogs: a file that was named in this pass is waited for from now on.
        self.go_on(ui, snapshot);
    }

    /// Where to export to, how, and what comes of it.
    fn ask_export(&mut self, ui: &Ui, snapshot: &Snapshot) {
        self.preview_export(snapshot);
        let is_native = snapshot.opened.as_ref().is_some_and(|opened| opened.is_native);
        let left_out = match self.export_dialog.is_open() {
            true => self.view.n_left_out(),
            false => None,
        };
        let report = self.view.previewed();
        let (mapping, previews) = (&mut self.mapping, &mut self.view.settings.previews_export);
        let choices = |ui: &mut Ui| {
            if is_native {
                export_options::ui(mapping, ui);
            }
            if let Some((n, all)) = left_out {
                ui.label(format!("{n} of {all} splats are left out, as edited (tab Edit)."));
            }
            export_options::preview(previews, ui);
        };
        let told = |ui: &mut Ui| export_options::report(report.as_ref(), ui);
        match self.export_dialog.ui(ui, self.wakes.waker(), choices, told) {
            None => {}
            Some(PathAnswer::Cancelled) => self.forget_named(),
            Some(PathAnswer::Path(path)) => {
                let number = self.begin_write();
                let left_out = self.view.editor().left_out();
                self.worker.send(WorkerOrder::Export(number, path, self.mapping, left_out));
            }
        }
    }

    /// Draws the picture of now into a file beside what is open.
    pub(super) fn save_picture(&mut self, snapshot: &Snapshot) {
        let (Some(opened), Some(still)) = (&snapshot.opened, self.view.still()) else { return };
        let path = opened.files.path("view.png");
        if let Err(error) = self.still.start(still, path, self.wakes.waker().clone()) {
            let text = format!("no thread to draw the picture on could be started: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
    }

    /// Where a film of the path goes, and what came of the one before.
    fn ask_film(&mut self, ui: &Ui, snapshot: &Snapshot) {
        if let Some((kind, text)) = self.film.take() {
            self.worker.send(WorkerOrder::Report(kind, text));
        }
        let path = &mut self.path;
        let choices = |ui: &mut Ui| panels::path::film_choices(path, ui);
        let Some(PathAnswer::Path(output)) =
            self.film_dialog.ui(ui, self.wakes.waker(), choices, |_| ())
        else {
            return;
        };
        let (Some(opened), Some(path)) = (&snapshot.opened, self.path.paced()) else { return };
        let settings = &self.view.settings;
        let method = settings.method(settings.renderer, Lens::Pinhole);
        let plain = RenderOptions::viewport(method, settings.background.rgb(), opened.home.radius);
        let order = FilmOrder {
            path,
            size: self.path.size,
            output,
            options: RenderOptions { exposing: settings.exposing, ..plain },
            left_out: self.view.editor().left_out(),
            is_aside: snapshot.state == RunState::Training,
        };
        let scene = self.view.learned().clone();
        if let Err(error) = self.film.start(scene, order, self.wakes.waker().clone()) {
            let text = format!("no thread to draw a film on could be started: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
        }
    }

    /// Has the view show what is chosen in the dialog, while that is open.
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
            let text = format!("no thread to preview the file on could be started: {error}");
            self.worker.send(WorkerOrder::Report(NoticeKind::Error, text));
            self.view.settings.previews_export = false;
        }
    }

    /// The number of the file to write next, which is what waited for its name now waits for.
    fn begin_write(&mut self) -> u64 {
        // A number and not the path: the snapshot still tells the outcome of an earlier file, which
        // may have had the same name.
        let number = self.worker.new_number();
        self.pending = self.pending.take().map(|pending| pending.named(number));
        number
    }

    /// A file that gets no name is not written.
    fn forget_named(&mut self) {
        self.pending = self.pending.take().filter(|p| !matches!(p, Pending::Naming(_)));
    }

    /// Asks about unsaved training, and lets go ahead what need not wait any more.
    fn go_on(&mut self, ui: &Ui, snapshot: &Snapshot) {
        // Taken out and put back while it waits: the questions are drawn anew in every pass.
        let Some(pending) = self.pending.take() else { return };
        match pending.after(snapshot.latest_write) {
            AfterWrite::Wait(Pending::Asking(next)) => self.ask(next, ui, snapshot.unsaved_frames),
            AfterWrite::Wait(waiting) => {
                let exported = self.worker.file_progress();
                let is_given_up =
                    matches!(waiting, Pending::Writing(..)) && dialogs::wait_for_file(ui, exported);
                if is_given_up && exported.is_some() {
                    self.worker.cancel_file();
                }
                self.pending = Some(waiting).filter(|_| !is_given_up);
            }
            AfterWrite::GoAhead(next) => self.go_ahead(next, ui),
            AfterWrite::GiveUp => {}
        }
    }

    fn ask(&mut self, next: Continuation, ui: &Ui, n_frames: usize) {
        match dialogs::confirm_discard(ui, n_frames) {
            None => self.pending = Some(Pending::Asking(next)),
            Some(Decision::Discard) => self.go_ahead(next, ui),
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

    fn go_ahead(&mut self, next: Continuation, ui: &Ui) {
        match next {
            Continuation::Send(order) => self.worker.send(order),
            Continuation::Close => {
                // The command comes back as a request to close, which must
                // not be asked about again.
                self.may_close = true;
                ui.ctx().send_viewport_cmd(ViewportCommand::Close);
            }
        }
    }
}
