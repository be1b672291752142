//! Keys, buttons and the window's own events.

use super::Studio;
use crate::app::command::UiCommand;
use crate::app::pending::{Continuation, Pending};
use crate::app::state::{Snapshot, Subject};
use crate::app::worker::WorkerOrder;
use eframe::egui::{Context, FocusDirection, Key, Ui, ViewportCommand};
use std::path::PathBuf;

impl Studio {
    pub(super) fn apply_command(&mut self, command: UiCommand, snapshot: &Snapshot) {
        if !command.is_legal(snapshot.state, snapshot.source) {
            return;
        }
        match command {
            UiCommand::Open => self.open_dialog.show(),
            UiCommand::OpenDemo => self.discard_then(WorkerOrder::Open(Subject::Demo), snapshot),
            UiCommand::Train => self.worker.send(WorkerOrder::Train),
            UiCommand::Pause => self.worker.send(WorkerOrder::Pause),
            UiCommand::Step => self.worker.send(WorkerOrder::Step),
            UiCommand::Follow => self.worker.send(WorkerOrder::Follow(!snapshot.follows)),
            UiCommand::Reset => self.discard_then(WorkerOrder::Reset, snapshot),
            UiCommand::Save => self.save_dialog.show(),
            UiCommand::Export => self.export_dialog.show(),
            UiCommand::FrameScene
            | UiCommand::Home
            | UiCommand::ToggleRenderer
            | UiCommand::PreviousCamera
            | UiCommand::NextCamera
            | UiCommand::RideAlong
            | UiCommand::Measure
            | UiCommand::Cameras
            | UiCommand::Grid
            | UiCommand::ComparePhoto => {
                if let Some(opened) = &snapshot.opened {
                    self.view.apply(command, opened);
                }
            }
            UiCommand::Deselect => self.worker.send(WorkerOrder::Inspect(None)),
            UiCommand::Help => self.help_is_open = !self.help_is_open,
        }
    }

    /// Keys are left to text fields and open questions.
    pub(super) fn take_keys(&mut self, ui: &Ui, snapshot: &Snapshot) {
        let dialogs = [&self.open_dialog, &self.save_dialog, &self.export_dialog];
        let asks = self.pending.is_some() || dialogs.iter().any(|dialog| dialog.is_open());
        // egui says so of any widget that has the focus, not of text fields alone.
        if asks || ui.ctx().egui_wants_keyboard_input() {
            return;
        }
        let toggles = UiCommand::ToggleRenderer.is_legal(snapshot.state, snapshot.source);
        if toggles && ui.input(|i| i.key_pressed(Key::Tab)) {
            // The key is a command's; it would also move the focus, and keys with it.
            ui.memory_mut(|memory| memory.move_focus(FocusDirection::None));
        }
        for command in UiCommand::ALL {
            if !command.is_legal(snapshot.state, snapshot.source) {
                continue;
            }
            let keys = command.shortcuts();
            // With Ctrl a flight goes slowly: its keys neither save nor export meanwhile.
            if self.view.is_flying() && keys.iter().any(|key| key.modifiers.command) {
                continue;
            }
            if ui.input_mut(|i| keys.iter().any(|key| i.consume_shortcut(key))) {
                self.apply_command(command, snapshot);
            }
        }
    }

    /// Opens a path, or calibrates what is open by it.
    pub(super) fn open_path(&mut self, path: PathBuf, snapshot: &Snapshot) {
        self.discard_then(order_to_open(path), snapshot);
    }

    pub(super) fn take_dropped(&mut self, ui: &Ui, snapshot: &Snapshot) {
        // The first of several: only one thing is open at a time.
        let dropped = ui.input(|i| i.raw.dropped_files.first().map(|f| f.path().to_owned()));
        if let Some(path) = dropped {
            self.discard_then(order_to_open(path), snapshot);
        }
    }

    /// Closing the window is asked about like everything else that forgets training.
    pub(super) fn take_close_request(&mut self, ctx: &Context, snapshot: &Snapshot) {
        let asked = ctx.input(|i| i.viewport().close_requested());
        if !asked || self.may_close {
            return;
        }
        // A question or a file that is under way is kept and now leads to closing: the same
        // training is not asked about twice.
        let waiting = self.pending.take();
        if waiting.is_none() && !snapshot.has_training_to_lose() {
            return;
        }
        // In this very pass: eframe closes unless it finds this among the commands of the pass.
        ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        if ctx.input(|i| i.viewport().minimized == Some(true)) {
            // Closed from the task bar: nobody would see the question.
            ctx.send_viewport_cmd(ViewportCommand::Minimized(false));
            ctx.send_viewport_cmd(ViewportCommand::Focus);
        }
        self.pending = Some(match waiting {
            Some(waiting) => waiting.instead(Continuation::Close),
            None => Pending::Asking(Continuation::Close),
        });
    }
}

/// Calibrations are opened for what is open already.
pub(super) fn order_to_open(path: PathBuf) -> WorkerOrder {
    match path.extension() {
        Some(extension) if extension == "ron" => WorkerOrder::Calibrate(path),
        _ => WorkerOrder::Open(Subject::Path(path)),
    }
}
