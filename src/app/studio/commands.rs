//! Executes commands from buttons, shortcuts and window events.

use super::Studio;
use super::command_line::command_line;
use super::dialogs::{Dialogs, about, help, order_to_open};
use super::dock::reset_layout;
use super::film_tools::FilmTools;
use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use crate::app::detail::finer;
use crate::app::edit::editor::EditCounts;
use crate::app::export_options;
use crate::app::export_options::ExportKind;
use crate::app::film::FilmRequest;
use crate::app::opening;
use crate::app::opening::PathProblem;
use crate::app::panels::path::{film_choices, picture_choices};
use crate::app::panels::status::Answer;
use crate::app::path_dialog;
use crate::app::path_dialog::{PathAnswer, Purpose};
use crate::app::rescue::AbandonedRun;
use crate::app::state::{NoticeKind, RunState, Snapshot, Subject};
use crate::app::viewer::export_preview::ExportChoice;
use crate::app::worker::{Export, Waker, WorkerOrder};
use crate::eval::report;
use crate::export::ModelFormat;
use crate::export::video::{check_encoder, too_large};
use crate::render::{Lens, RenderOptions};
use eframe::egui::{FocusDirection, InputState, Key, Modifiers, Popup, Ui, ViewportCommand};
use std::path::{Path, PathBuf};

impl Studio {
    pub(super) fn apply_command(&mut self, command: UiCommand, snapshot: &Snapshot) {
        if !command.is_available(snapshot.state, snapshot.source) {
            return;
        }
        // Read by the test that drives the program with a mouse (`tests/app/journey.rs`).
        tracing::debug!("command: {command:?}");
        match command {
            UiCommand::Open => self.dialogs.open(),
            UiCommand::OpenDemo => {
                self.confirm_then_send(WorkerOrder::Open(Subject::Demo), snapshot)
            }
            UiCommand::Train => {
                self.apply_settings(snapshot);
                self.worker.send(WorkerOrder::Train);
            }
            UiCommand::Pause => self.worker.send(WorkerOrder::Pause),
            UiCommand::Step => {
                self.apply_settings(snapshot);
                self.worker.send(WorkerOrder::Step);
            }
            UiCommand::Follow => self.worker.send(WorkerOrder::Follow(!snapshot.following.is_on)),
            UiCommand::Reset => self.confirm_then_send(WorkerOrder::Reset, snapshot),
            UiCommand::RetrainFiner => self.retrain_finer(snapshot),
            UiCommand::Save => self.dialogs.save.show(),
            UiCommand::Export => self.dialogs.export.show(),
            UiCommand::SavePicture => {
                self.film.still_size = self.view.camera.size_px;
                self.dialogs.picture.show();
            }
            UiCommand::FrameStrip => self.layout.shows_frames = !self.layout.shows_frames,
            UiCommand::ResetLayout => reset_layout(&mut self.layout, &self.shell.egui),
            UiCommand::CompareModel => self.dialogs.compare.show(),
            UiCommand::RemoveModel => self.view.comparison.remove_model(),
            UiCommand::Deselect => {
                self.worker.send(WorkerOrder::Inspect(None));
                self.apply_to_view(command, snapshot);
            }
            UiCommand::CopyCommandLine => self.copy_command_line(snapshot),
            UiCommand::Find => self.dialogs.finder.show(),
            UiCommand::FocusControls => {
                self.shell.egui.memory_mut(|memory| match memory.focused() {
                    Some(control) => memory.surrender_focus(control),
                    None => memory.move_focus(FocusDirection::Next),
                })
            }
            UiCommand::Help => self.dialogs.help_is_open = !self.dialogs.help_is_open,
            UiCommand::About => self.dialogs.about_is_open = true,
            // Returns as a close request, which may ask for confirmation first.
            UiCommand::Quit => self.shell.egui.send_viewport_cmd(ViewportCommand::Close),
            of_view => {
                debug_assert!(of_view.is_view_command(), "{of_view:?} does nothing");
                self.apply_to_view(of_view, snapshot);
            }
        }
    }

    fn apply_to_view(&mut self, command: UiCommand, snapshot: &Snapshot) {
        if let Some(opened) = &snapshot.opened {
            self.view.apply(command, opened);
        }
    }

    fn copy_command_line(&self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let line = command_line(opened, &self.training);
        let (kind, text) = match line {
            Ok(line) => {
                let text = format!("Copied: {line}");
                self.shell.egui.copy_text(line);
                (NoticeKind::Info, text)
            }
            Err(error) => (NoticeKind::Warning, error.to_string()),
        };
        self.report(kind, text);
    }

    pub(super) fn unavailable_reason(
        &self,
        action: Action,
        snapshot: &Snapshot,
    ) -> Option<&'static str> {
        match (action, &snapshot.opened) {
            (Action::Command(command), _) => {
                let removes = command == UiCommand::RemoveModel;
                let vain =
                    removes.then(|| self.view.comparison.remove_unavailable_reason()).flatten();
                let refines = command == UiCommand::RetrainFiner;
                let hidden = (refines && finer(snapshot).is_none())
                    .then_some("Noise of the depth hides finer detail");
                let useless = self.view.editor().unavailable_reason(command);
                let in_state = command.unavailable_reason(snapshot.state, snapshot.source);
                in_state.or(vain).or(hidden).or(useless)
            }
            (Action::Tab(_), _) => None,
            (Action::Mode(mode), Some(opened)) => self.view.mode_unavailable_reason(mode, opened),
            (Action::Color(mode), Some(opened)) => self.view.color_unavailable_reason(mode, opened),
            (Action::Mode(_) | Action::Color(_), None) => Some("Nothing is open"),
        }
    }

    pub(super) fn is_on(&self, command: UiCommand, snapshot: &Snapshot) -> bool {
        let is_open = snapshot.opened.is_some();
        match command {
            UiCommand::Follow => snapshot.following.is_on,
            UiCommand::AutoCamera => is_open && self.view.camera.is_guided(),
            UiCommand::Measure => self.view.overlays.is_measuring(),
            UiCommand::Cameras => self.view.settings.shows_cameras,
            UiCommand::Points => self.view.settings.shows_points,
            UiCommand::Grid => self.view.settings.shows_grid,
            UiCommand::FrameStrip => self.layout.shows_frames,
            UiCommand::ComparePhoto => self.view.comparison.mode().has_photo(),
            _ => false,
        }
    }

    pub(super) fn apply_action(&mut self, action: Action, snapshot: &Snapshot) {
        match (action, &snapshot.opened) {
            (Action::Command(command), _) => self.apply_command(command, snapshot),
            (Action::Tab(tab), _) => self.layout.activate(tab),
            (Action::Mode(mode), Some(opened)) => self.view.set_mode(mode, opened),
            (Action::Color(mode), _) => self.view.settings.color_mode = mode,
            (Action::Mode(_), None) => {}
        }
    }

    /// Executes the commands whose shortcuts are pressed. Text fields, dialogs and menus have priority.
    /// A focused control receives the keys that activate it, change it or move the focus.
    pub(super) fn handle_shortcuts(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let asks =
            self.unsaved.is_pending() || self.dialogs.take_keys() || Popup::is_any_open(ui.ctx());
        if asks || ui.ctx().text_edit_focused() {
            return;
        }
        // Escape closes the help window before it clears the selection.
        let closes = |i: &mut InputState| i.consume_key(Modifiers::NONE, Key::Escape);
        if self.dialogs.help_is_open && ui.input_mut(closes) {
            self.dialogs.help_is_open = false;
        }
        // Shift+Tab moves the focus to the controls even though Tab alone is a command.
        let leads_on = ui.input(|i| i.modifiers.shift && i.key_pressed(Key::Tab));
        let is_of_controls = leads_on || ui.memory(|memory| memory.focused().is_some());
        let toggles = UiCommand::ToggleRenderer.is_available(snapshot.state, snapshot.source);
        if toggles && !is_of_controls && ui.input(|i| i.key_pressed(Key::Tab)) {
            // Tab is a command here; egui would also move the focus, and with it the keyboard input.
            ui.memory_mut(|memory| memory.move_focus(FocusDirection::None));
        }
        let mut commands = UiCommand::ALL;
        // Redo first: the shortcut of Undo also matches while the additional modifier of Redo is held.
        commands.sort_by_key(|command| *command != UiCommand::Redo);
        for command in commands {
            if !command.is_available(snapshot.state, snapshot.source) {
                continue;
            }
            if is_of_controls && command.conflicts_with_controls() {
                continue;
            }
            let keys = command.shortcuts();
            // Ctrl slows down flying, so Ctrl+S and Ctrl+E must not save or export meanwhile.
            if self.view.camera.is_flying() && keys.iter().any(|key| key.modifiers.command) {
                continue;
            }
            if ui.input_mut(|i| keys.iter().any(|key| i.consume_shortcut(key))) {
                self.apply_command(command, snapshot);
            }
        }
    }

    /// Opens a path. A calibration file is applied to the open dataset.
    pub(super) fn open_path(&mut self, path: PathBuf, snapshot: &Snapshot) {
        let (reading, follows) =
            (self.training.of_dataset(&path).reading, snapshot.following.is_on);
        let check = move |path: &Path| opening::check(path, &reading, follows);
        self.unsaved.open(path, &self.worker, snapshot, self.shell.waker(), check);
    }

    pub(super) fn handle_dropped_files(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let paths: Vec<PathBuf> =
            ui.input(|i| i.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        let Some((first, others)) = paths.split_first() else { return };
        if !others.is_empty() {
            // A user may drop all photographs of a capture instead of its folder.
            let text = format!(
                "only one dataset or model can be open: {} is opened, {} other dropped paths were left out; to open a capture, drop its folder",
                first.display(),
                others.len()
            );
            self.report(NoticeKind::Warning, text);
        }
        self.open_path(first.clone(), snapshot);
    }

    pub(super) fn confirm_then_send(&mut self, order: WorkerOrder, snapshot: &Snapshot) {
        self.unsaved.send(order, &self.worker, snapshot);
    }

    pub(super) fn report(&self, kind: NoticeKind, text: String) {
        self.worker.send(WorkerOrder::Report(kind, text));
    }

    /// Returns true if a thread was started; otherwise reports the error.
    fn is_started(&self, purpose: &str, started: std::io::Result<()>) -> bool {
        if let Err(error) = &started {
            let text = format!("cannot start a thread to {purpose}: {error}");
            self.report(NoticeKind::Error, text);
        }
        started.is_ok()
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
            // Only in this window: the program offers the run again at its next startup.
            Some(Answer::NotNow) => self.panels.postponed_slot = Some(run.slot.clone()),
        }
    }

    pub(super) fn show_dialogs(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let waker = self.shell.waker().clone();
        // No action waits for this dialog, so cancelling it has no effect.
        self.dialogs.reopen_after_failure(snapshot);
        let (reading, follows) = (self.dialogs.reading, snapshot.following.is_on);
        let check = move |path: &Path| opening::check(path, &reading, follows);
        let Dialogs { open, reading, .. } = &mut self.dialogs;
        let choices = |ui: &mut Ui| path_dialog::reading(reading, ui);
        if let Some(PathAnswer::Path(path)) = open.ui(ui, &waker, check, choices, |_| ()) {
            let reading = *reading;
            self.training.note(&path, |of| of.reading = reading);
            self.apply_training();
            self.confirm_then_send(order_to_open(path), snapshot);
        }
        if let Some(PathAnswer::Path(path)) =
            self.dialogs.compare.ui(ui, &waker, opening::check_model, |_| (), |_| ())
        {
            let started = self.view.compare_with(path);
            self.is_started("read the model", started);
        }
        match self.dialogs.save.ui(ui, &waker, |_| Ok(()), |_| (), |_| ()) {
            None => {}
            Some(PathAnswer::Cancelled) => self.unsaved.cancel_naming(),
            Some(PathAnswer::Path(path)) => {
                let number = self.unsaved.begin_write(&self.worker);
                self.dialogs.writing = Some((number, Purpose::Save));
                self.worker.send(WorkerOrder::Save(number, path));
            }
        }
        self.ask_export(ui, &waker, snapshot);
        self.ask_film(ui, &waker, snapshot);
        self.ask_picture(ui, &waker, snapshot);
        let filmed = self.film.thread.poll_notice();
        if let Some((NoticeKind::Error, text)) = &filmed {
            self.dialogs.film.show_problem(text.clone());
        }
        let notices = [filmed, self.film.still.take()];
        notices.into_iter().flatten().for_each(|(kind, text)| self.report(kind, text));
        help(ui, &mut self.dialogs.help_is_open);
        about(ui, &mut self.dialogs.about_is_open, &self.shell.adapter);
        // Taken out, because the closure borrows the whole window.
        let mut finder = std::mem::take(&mut self.dialogs.finder);
        let chosen = finder.ui(ui, |action| self.unavailable_reason(action, snapshot).is_none());
        self.dialogs.finder = finder;
        if let Some(action) = chosen {
            self.apply_action(action, snapshot);
        }
        // Resolved after the dialogs, so that a file named in this pass is already taken into account.
        self.unsaved.resolve(&mut self.dialogs, &self.worker, ui, snapshot);
    }

    fn ask_export(&mut self, ui: &Ui, waker: &Waker, snapshot: &Snapshot) {
        self.preview_export(snapshot);
        let is_native = snapshot.opened.as_ref().is_some_and(|opened| opened.is_native);
        let (editor, palette) = (&mut self.view.editor, &self.view.palette);
        let counts = self.dialogs.export.is_open().then(|| editor.counts(palette));
        let report = self.view.comparison.export_preview_report();
        let Dialogs { kind, mapping, spz_version, export, .. } = &mut self.dialogs;
        let has_mesh = snapshot.opened.as_ref().is_some_and(|opened| opened.scene().is_some());
        let format = kind.splat_format(&export.entered()).ok();
        let asked = *kind;
        let previews = &mut self.view.settings.panels.previews_export;
        let choices = |ui: &mut Ui| {
            export_options::kind(kind, has_mesh, ui);
            if *kind == ExportKind::Splats {
                if is_native {
                    export_options::mapping(mapping, ui);
                }
                if format == Some(ModelFormat::Spz) {
                    export_options::spz(spz_version, ui);
                }
            }
            if let Some(EditCounts { all, left_out: n @ 1.., .. }) = counts {
                ui.label(format!("{n} of {all} splats are excluded by edits (Edit tab)."));
            }
            if *kind == ExportKind::Splats {
                export_options::preview(previews, ui);
            }
        };
        let below = |ui: &mut Ui| export_options::report(report.as_ref(), ui);
        let check = move |path: &Path| asked.check(path).map_err(|error| error.to_string().into());
        match export.ui(ui, waker, check, choices, below) {
            None => {}
            Some(PathAnswer::Cancelled) => self.unsaved.cancel_naming(),
            Some(PathAnswer::Path(path)) => {
                let Dialogs { kind, mapping, spz_version, .. } = self.dialogs;
                let number = self.unsaved.begin_write(&self.worker);
                self.dialogs.writing = Some((number, Purpose::Export));
                self.worker.send(WorkerOrder::Export(Export {
                    number,
                    path,
                    kind,
                    mapping,
                    spz_version,
                    left_out: self.view.editor().left_out(),
                }));
            }
        }
    }

    fn preview_export(&mut self, snapshot: &Snapshot) {
        let Some(opened) = &snapshot.opened else { return };
        let Dialogs { kind, mapping, spz_version, export, .. } = &self.dialogs;
        let is_wanted = export.is_open()
            && *kind == ExportKind::Splats
            && self.view.settings.panels.previews_export;
        let format = is_wanted.then(|| ModelFormat::from_path(&export.entered()).ok());
        let choice = format.flatten().map(|format| ExportChoice {
            format,
            mapping: *mapping,
            spz_version: *spz_version,
            left_out: self.view.editor().left_out(),
        });
        let started = self.view.preview_export(choice, opened, snapshot.state);
        if !self.is_started("preview the file", started) {
            // Otherwise every pass would report the same error again.
            self.view.settings.panels.previews_export = false;
        }
    }

    fn ask_picture(&mut self, ui: &Ui, waker: &Waker, snapshot: &Snapshot) {
        let size = self.film.still_size;
        let (chosen, shown) = (&mut self.film.still_size, self.view.camera.size_px);
        let choices = |ui: &mut Ui| picture_choices(chosen, shown, ui);
        let check = move |path: &Path| check_picture(path, size);
        let answer = self.dialogs.picture.ui(ui, waker, check, choices, |_| ());
        let Some(PathAnswer::Path(path)) = answer else { return };
        let is_training = snapshot.state == RunState::Training;
        let Some(still) = self.view.still(size, is_training) else { return };
        let started = self.film.still.start(still, path, waker.clone());
        self.is_started("draw the picture", started);
    }

    fn ask_film(&mut self, ui: &Ui, waker: &Waker, snapshot: &Snapshot) {
        let FilmTools { path, thread, .. } = &mut self.film;
        let choices = |ui: &mut Ui| film_choices(path, ui);
        let check = |path: &Path| check_encoder(path).map_err(|error| error.to_string().into());
        let answer = self.dialogs.film.ui(ui, waker, check, choices, |_| ());
        let Some(PathAnswer::Path(output)) = answer else { return };
        let (Some(opened), Some(paced)) = (&snapshot.opened, path.paced()) else { return };
        let settings = &self.view.settings;
        let method = settings.method(settings.renderer, Lens::Pinhole);
        let plain = RenderOptions::viewport(method, settings.background_rgb(), opened.home.radius);
        let order = FilmRequest {
            path: paced,
            size: path.size,
            output,
            options: RenderOptions { exposure_mode: settings.exposing, ..plain },
            left_out: self.view.editor().left_out(),
            is_beside_training: snapshot.state == RunState::Training,
        };
        let started = thread.start(self.view.learned().clone(), order, waker.clone());
        self.is_started("render the film", started);
    }
}

/// Checks the name of a picture, and that free memory holds one of `size`.
fn check_picture(path: &Path, size: [u32; 2]) -> Result<(), PathProblem> {
    let refuse = |why: &str| Err(format!("{}: {why}", path.display()).into());
    if !path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("png")) {
        return refuse("expected a name that ends in .png");
    }
    match report::available_bytes().and_then(|free| too_large(size, free)) {
        Some(found) => refuse(&found),
        None => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_picture_that_memory_cannot_hold_is_refused_by_its_dialog() {
        let refused = |name: &str, size| {
            let found = check_picture(Path::new(name), size).err();
            found.map(|problem| problem.text)
        };
        assert_eq!(refused("view.PNG", [64, 48]), None);
        assert!(refused("view.jpg", [64, 48]).is_some_and(|text| text.contains("ends in .png")));
        let text = refused("view.png", [1 << 20; 2]).unwrap_or_default();
        assert!(text.starts_with("view.png: ") && text.contains("smaller picture"), "{text}");
    }
}
