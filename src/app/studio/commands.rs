//! Executes commands from buttons, shortcuts and window events.

use super::Studio;
use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use crate::app::opening::{Continuation, Pending};
use crate::app::state::{GivenCalibration, NoticeKind, Opened, Snapshot, Subject};
use crate::app::training::TrainSettings;
use crate::app::worker::WorkerOrder;
use crate::train::setting::Preset;
use crate::train::setting::table::{SettingLayer, Spelling};
use eframe::egui::{
    Context, FocusDirection, InputState, Key, Modifiers, Popup, Ui, ViewportCommand,
};
use std::path::{Path, PathBuf, absolute};

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
            UiCommand::RemoveModel => self.view.comparison.remove_model(),
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
                let vain =
                    removes.then(|| self.view.comparison.remove_unavailable_reason()).flatten();
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
            if self.view.camera.is_flying() && keys.iter().any(|key| key.modifiers.command) {
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

/// Reason why no equivalent command exists.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub enum NoCommandLine {
    /// The built-in scene, which is not on disk.
    #[error("the built-in scene has no folder that a command could name: open a dataset first")]
    BuiltIn,
    /// A path that is not UTF-8.
    #[error("{0}: expected a path in UTF-8 for use in a command; rename it first")]
    Path(PathBuf),
    /// The calibration in use has no file.
    #[error(
        "the calibration in use came with a run, not from a file that a command could name: open its calibration file here first"
    )]
    Calibration,
}

/// Returns the `train` command, quoted for this platform's shell. Its output folder lies next to the open
/// dataset.
///
/// # Errors
/// [`NoCommandLine`] if no command reproduces the run.
pub fn command_line(
    opened: &Opened,
    training: &TrainSettings,
    calibration: Option<&GivenCalibration>,
) -> Result<String, NoCommandLine> {
    let dataset = opened.dataset.as_ref().ok_or(NoCommandLine::BuiltIn)?;
    let folder = dataset.path.as_deref().ok_or(NoCommandLine::BuiltIn)?;
    let mut words = vec!["vbgs-studio".to_owned(), "train".to_owned(), path(folder)?];
    words.extend(["--out".to_owned(), path(&opened.files.path("run"))?]);
    match &opened.path {
        // A checkpoint stores its own settings.
        Some(run) if run != folder => words.extend(["--resume".to_owned(), path(run)?]),
        _ => {
            words.extend(settings(training));
            if let Some(given) = calibration {
                let file = given.file.as_deref().ok_or(NoCommandLine::Calibration)?;
                words.extend(["--calibration".to_owned(), path(file)?]);
            }
        }
    }
    if let Some(plan) = &opened.plan {
        let measured = dataset.evaluation(plan.split).new_views;
        if measured.split != plan.split {
            words.extend(["--eval".to_owned(), dataset.splits[measured.split].name.clone()]);
        }
    }
    Ok(words.iter().map(|word| shell_quoted(word)).collect::<Vec<_>>().join(" "))
}

fn settings(training: &TrainSettings) -> Vec<String> {
    if training.preset == Preset::Paper {
        let preset = ["--preset", "paper"].map(str::to_owned);
        return preset.into_iter().chain(layer_options(&training.paper)).collect();
    }
    layer_options(&training.scene)
}

/// Options of the settings that differ from the preset.
fn layer_options<L: SettingLayer>(layer: &L) -> Vec<String> {
    let given = L::TABLE.iter().filter_map(|setting| {
        let value = (setting.given)(layer)?;
        match setting.about.spelling {
            Spelling::Option(option, _) => Some([option.to_owned(), value]),
            Spelling::Name => {
                Some(["--set".to_owned(), format!("{}={value}", setting.about.field)])
            }
        }
    });
    given.flatten().collect()
}

/// Absolute path, since the shell's current folder may differ from the window's.
fn path(path: &Path) -> Result<String, NoCommandLine> {
    let full = absolute(path).unwrap_or_else(|_| path.to_owned());
    full.to_str().map(str::to_owned).ok_or(NoCommandLine::Path(full))
}

/// Quotes a word for the shell if necessary.
fn shell_quoted(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "_-./:=,+@%\\".contains(c);
    if !word.is_empty() && word.chars().all(is_plain) && (cfg!(windows) || !word.contains('\\')) {
        return word.to_owned();
    }
    if cfg!(windows) {
        // File names contain no quotes on Windows.
        format!("\"{word}\"")
    } else {
        format!("'{}'", word.replace('\'', r"'\''"))
    }
}

#[cfg(test)]
mod command_line_tests {
    use super::*;
    use crate::pipeline::settings::scene::SceneOverrides;
    use crate::train::paper::config::Candidates;
    use crate::train::scene::config::BirthRule;
    use crate::train::scene::units::StructuralScale;

    #[test]
    #[cfg(unix)]
    fn words_with_anything_but_plain_letters_are_quoted() {
        for (word, expected) in [
            ("--scale", "--scale"),
            ("/a/b_c.1", "/a/b_c.1"),
            ("", "''"),
            ("a room", "'a room'"),
            ("it's $HOME", r"'it'\''s $HOME'"),
            (r"back\slash", r"'back\slash'"),
            ("Küche", "'Küche'"),
        ] {
            assert_eq!(shell_quoted(word), expected);
        }
    }

    #[test]
    fn settings_are_said_as_the_command_line_says_them() {
        let mut training = TrainSettings::default();
        assert!(settings(&training).is_empty(), "defaults need no options");
        training.scene = SceneOverrides {
            scale: Some(StructuralScale::Pixels(1.5)),
            births: Some(BirthRule::BodyCentred),
            cosine: Some(false),
            ..SceneOverrides::default()
        };
        let words = "--scale 1.5px --set births=body-centred --set cosine=false";
        assert_eq!(settings(&training).join(" "), words);
        training.preset = Preset::Paper;
        assert_eq!(settings(&training), ["--preset", "paper"]);
        training.paper.components = Some(2000);
        training.paper.candidates = Some(Candidates::Dense);
        let words = "--preset paper --set components=2000 --set candidates=dense";
        assert_eq!(settings(&training).join(" "), words);
    }
}
