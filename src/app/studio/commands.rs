//! Executes commands from buttons, shortcuts and window events.

use super::Studio;
use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use crate::app::command_line::command_line;
use crate::app::pending::{Continuation, Pending};
use crate::app::state::{NoticeKind, Snapshot, Subject};
use crate::app::worker::WorkerOrder;
use eframe::egui::{
    Context, FocusDirection, InputState, Key, Modifiers, Popup, Ui, ViewportCommand,
};
use std::path::PathBuf;

impl Studio {
    pub(super) fn apply_command(&mut self, command: UiCommand, snapshot: &Snapshot) {
        if !command.is_available(snapshot.state, snapshot.source) {
            return;
        }
        tracing::debug!("command: {command:?}");
        match command {
            UiCommand::Open => self.open_dialog.show(),
            UiCommand::OpenDemo => {
                self.confirm_then_send(WorkerOrder::Open(Subject::Demo), snapshot)
            }
            UiCommand::Train => {
                self.apply_detail(snapshot);
                self.worker.send(WorkerOrder::Train);
            }
            UiCommand::Pause => self.worker.send(WorkerOrder::Pause),
            UiCommand::Step => {
                self.apply_detail(snapshot);
                self.worker.send(WorkerOrder::Step);
            }
            UiCommand::Follow => self.worker.send(WorkerOrder::Follow(!snapshot.follows)),
            UiCommand::Reset => self.confirm_then_send(WorkerOrder::Reset, snapshot),
            UiCommand::Save => self.save_dialog.show(),
            UiCommand::Export => self.export_dialog.show(),
            UiCommand::SavePicture => self.save_picture(snapshot),
            UiCommand::FrameStrip => self.layout.shows_frames = !self.layout.shows_frames,
            UiCommand::ResetLayout => self.reset_layout(),
            UiCommand::CompareModel => self.compare_dialog.show(),
            UiCommand::RemoveModel => self.view.remove_compared(),
            UiCommand::Deselect => {
                self.worker.send(WorkerOrder::Inspect(None));
                self.apply_to_view(command, snapshot);
            }
            UiCommand::CopyCommandLine => self.copy_command_line(snapshot),
            UiCommand::Find => self.finder.show(),
            UiCommand::FocusControls => self.egui.memory_mut(|memory| match memory.focused() {
                Some(control) => memory.surrender_focus(control),
                None => memory.move_focus(FocusDirection::Next),
            }),
            UiCommand::Help => self.help_is_open = !self.help_is_open,
            // Returns as a close request, which may ask for confirmation first.
            UiCommand::Quit => self.egui.send_viewport_cmd(ViewportCommand::Close),
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
        let line = command_line(opened, &self.training, snapshot.calibration.as_deref());
        let (kind, text) = match line {
            Ok(line) => {
                let text = format!("Copied: {line}");
                self.egui.copy_text(line);
                (NoticeKind::Info, text)
            }
            Err(error) => (NoticeKind::Warning, error.to_string()),
        };
        self.worker.send(WorkerOrder::Report(kind, text));
    }

    /// Reason why an action is unavailable, if any.
    pub(super) fn unavailable_reason(
        &self,
        action: Action,
        snapshot: &Snapshot,
    ) -> Option<&'static str> {
        match (action, &snapshot.opened) {
            (Action::Command(command), _) => {
                let removes = command == UiCommand::RemoveModel;
                let vain = removes.then(|| self.view.remove_unavailable_reason()).flatten();
                let useless = (!self.view.is_of_use(command)).then_some("Nothing to apply it to");
                command.unavailable_reason(snapshot.state, snapshot.source).or(vain).or(useless)
            }
            (Action::Tab(_), _) => None,
            (Action::Mode(mode), Some(opened)) => self.view.mode_unavailable_reason(mode, opened),
            (Action::Color(mode), Some(opened)) => mode.unavailable_reason(opened.available_modes),
            (Action::Mode(_) | Action::Color(_), None) => Some("Nothing is open"),
        }
    }

    /// True if a toggle command is on.
    pub(super) fn is_on(&self, command: UiCommand, snapshot: &Snapshot) -> bool {
        let is_open = snapshot.opened.is_some();
        match command {
            UiCommand::Follow => snapshot.follows,
            UiCommand::AutoCamera => is_open && self.view.is_guided(),
            UiCommand::Measure => self.view.is_measuring(),
            UiCommand::Cameras => self.view.settings.shows_cameras,
            UiCommand::Points => self.view.settings.shows_points,
            UiCommand::Grid => self.view.settings.shows_grid,
            UiCommand::FrameStrip => self.layout.shows_frames,
            UiCommand::ComparePhoto => self.view.mode().has_photo(),
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

    /// Executes shortcuts. Text fields, dialogs and menus have priority; a focused control receives the keys
    /// that activate it, change it or move the focus.
    pub(super) fn handle_shortcuts(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let dialogs = [
            &self.open_dialog,
            &self.compare_dialog,
            &self.save_dialog,
            &self.export_dialog,
            &self.film_dialog,
        ];
        let asks = self.pending.is_some()
            || self.finder.is_open()
            || Popup::is_any_open(ui.ctx())
            || dialogs.iter().any(|dialog| dialog.is_open());
        if asks || ui.ctx().text_edit_focused() {
            return;
        }
        // Escape closes the help window before it clears the selection.
        let closes = |i: &mut InputState| i.consume_key(Modifiers::NONE, Key::Escape);
        if self.help_is_open && ui.input_mut(closes) {
            self.help_is_open = false;
        }
        // Shift+Tab moves the focus to the controls even though Tab alone is a command.
        let leads_on = ui.input(|i| i.modifiers.shift && i.key_pressed(Key::Tab));
        let is_of_controls = leads_on || ui.memory(|memory| memory.focused().is_some());
        let toggles = UiCommand::ToggleRenderer.is_available(snapshot.state, snapshot.source);
        if toggles && !is_of_controls && ui.input(|i| i.key_pressed(Key::Tab)) {
            // Tab is a command here; egui would also move the focus, and with it the keyboard input.
            ui.memory_mut(|memory| memory.move_focus(FocusDirection::None));
        }
        for command in UiCommand::ALL {
            if !command.is_available(snapshot.state, snapshot.source) {
                continue;
            }
            if is_of_controls && command.conflicts_with_controls() {
                continue;
            }
            let keys = command.shortcuts();
            // Ctrl slows down flying, so Ctrl+S and Ctrl+E must not save or export meanwhile.
            if self.view.is_flying() && keys.iter().any(|key| key.modifiers.command) {
                continue;
            }
            if ui.input_mut(|i| keys.iter().any(|key| i.consume_shortcut(key))) {
                self.apply_command(command, snapshot);
            }
        }
    }

    /// Opens a path; a calibration file is applied to the open dataset.
    pub(super) fn open_path(&mut self, path: PathBuf, snapshot: &Snapshot) {
        self.confirm_then_send(order_to_open(path), snapshot);
    }

    pub(super) fn handle_dropped_files(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let paths: Vec<PathBuf> =
            ui.input(|i| i.raw.dropped_files.iter().map(|file| file.path().to_owned()).collect());
        match <[PathBuf; 1]>::try_from(paths) {
            Ok([path]) => self.confirm_then_send(order_to_open(path), snapshot),
            Err(none) if none.is_empty() => {}
            Err(several) => self.confirm_then_send(WorkerOrder::OpenFirst(several), snapshot),
        }
    }

    /// Handles a request to close the window: unsaved training must be confirmed.
    pub(super) fn handle_close_request(&mut self, ctx: &Context, snapshot: &Snapshot) {
        if snapshot.is_terminated && !self.may_close {
            // The program is terminated from outside, so no confirmation is possible.
            self.may_close = true;
            ctx.send_viewport_cmd(ViewportCommand::Close);
        }
        let asked = ctx.input(|i| i.viewport().close_requested());
        if !asked || self.may_close {
            return;
        }
        // A pending confirmation or file now leads to closing, so that the same training is not confirmed
        // twice.
        let waiting = self.pending.take();
        if waiting.is_none() && !snapshot.has_training_to_lose() {
            return;
        }
        // Must be sent in this pass: eframe closes unless it finds this command in the same pass.
        ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        if ctx.input(|i| i.viewport().minimized == Some(true)) {
            // A minimised window, closed from the task bar, would hide the confirmation.
            ctx.send_viewport_cmd(ViewportCommand::Minimized(false));
            ctx.send_viewport_cmd(ViewportCommand::Focus);
        }
        self.pending = Some(match waiting {
            Some(waiting) => waiting.instead(Continuation::Close),
            None => Pending::Asking(Continuation::Close),
        });
    }
}

/// Order for a path: calibration files apply to the open dataset, everything else is opened.
pub(super) fn order_to_open(path: PathBuf) -> WorkerOrder {
    match path.extension() {
        Some(extension) if extension == "ron" => WorkerOrder::Calibrate(path),
        _ => WorkerOrder::Open(Subject::Path(path)),
    }
}
