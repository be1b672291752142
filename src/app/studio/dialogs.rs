//! Dialogs of the window, and actions that wait for the user's confirmation.

use crate::app::action_finder::ActionFinder;
use crate::app::command::UiCommand;
use crate::app::export_options::ExportKind;
use crate::app::opening::{PathProblem, is_calibration};
use crate::app::path_dialog::{PathDialog, Purpose};
use crate::app::state::{OpenAs, Opened, Snapshot, Subject};
use crate::app::view_thread::take_finished;
use crate::app::wording;
use crate::app::worker::{Waker, Worker, WorkerOrder};
use crate::dataset::LoadOptions;
use crate::export::SpzVersion;
use crate::export::mapping::Mapping;
use crate::pipeline::job::Job;
use crate::pipeline::panic_report::PanicReport;
use eframe::egui::{
    Context, Grid, Id, Modal, ProgressBar, RichText, ScrollArea, Ui, ViewportCommand, Window,
};
use std::path::{Path, PathBuf};
use std::time::Duration;

pub(super) struct Dialogs {
    pub open: PathDialog,
    /// How the dataset of the open dialog is read.
    pub reading: LoadOptions,
    pub compare: PathDialog,
    pub save: PathDialog,
    pub export: PathDialog,
    pub film: PathDialog,
    /// Number of the file that is being written, and the purpose of the dialog that named it.
    pub writing: Option<(u64, Purpose)>,
    pub picture: PathDialog,
    pub kind: ExportKind,
    pub mapping: Mapping,
    pub spz_version: SpzVersion,
    pub finder: ActionFinder,
    pub help_is_open: bool,
    pub about_is_open: bool,
}

impl Default for Dialogs {
    fn default() -> Self {
        Self {
            open: PathDialog::new(Purpose::Open),
            reading: LoadOptions::default(),
            compare: PathDialog::new(Purpose::Compare),
            save: PathDialog::new(Purpose::Save),
            export: PathDialog::new(Purpose::Export),
            film: PathDialog::new(Purpose::Film),
            writing: None,
            picture: PathDialog::new(Purpose::Picture),
            kind: ExportKind::default(),
            mapping: Mapping::default(),
            spz_version: SpzVersion::default(),
            finder: ActionFinder::default(),
            help_is_open: false,
            about_is_open: false,
        }
    }
}

impl Dialogs {
    /// Shows the open dialog.
    pub fn open(&mut self) {
        self.reading = LoadOptions::default();
        self.open.show();
    }

    /// Shows the open dialog with a path and options.
    pub fn open_as(&mut self, OpenAs { path, reading }: OpenAs) {
        self.reading = reading;
        self.open.show_path(&path);
    }

    /// Shows the dialog of a file again if that could not be written.
    pub fn reopen_after_failure(&mut self, snapshot: &Snapshot) {
        let Some((failed, error)) = &snapshot.files.failed_write else { return };
        let dialog = match self.writing.take_if(|(number, _)| number == failed) {
            None => return,
            Some((_, Purpose::Save)) => &mut self.save,
            Some(_) => &mut self.export,
        };
        dialog.show_problem(error.to_string());
    }

    pub fn propose(&mut self, opened: &Opened) {
        for dialog in [&mut self.save, &mut self.export, &mut self.film, &mut self.picture] {
            dialog.propose(opened.serial, &opened.files);
        }
    }

    /// True if an open dialog or the open action finder takes keyboard input before shortcuts.
    pub fn take_keys(&self) -> bool {
        let Self { open, compare, save, export, film, picture, .. } = self;
        let all = [open, compare, save, export, film, picture];
        self.finder.is_open() || all.iter().any(|dialog| dialog.is_open())
    }
}

enum Continuation {
    Send(WorkerOrder),
    Close,
}

/// Event for which a pending action waits.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Stage {
    /// Waits until the user decides about unsaved training.
    Decision,
    /// Waits until the user names a file.
    Name,
    /// Waits until the file with this number is written.
    File(u64),
}

/// Time after which the user is asked although the path could not be checked yet.
const LONGEST_CHECK: Duration = Duration::from_secs(1);

/// Action that would discard unsaved training and waits for confirmation.
#[derive(Default)]
pub(super) struct UnsavedWork {
    /// Path that is checked before the question whether training may be discarded for it.
    checking: Option<(PathBuf, Job<Result<(), PathProblem>>)>,
    pending: Option<(Stage, Continuation)>,
    /// True if the window may close without confirmation.
    pub may_close: bool,
}

impl UnsavedWork {
    pub fn is_pending(&self) -> bool {
        self.pending.is_some()
    }

    /// Opens a path at once if no training would be lost, otherwise after confirmation. Before the user is
    /// asked, `check` must find that the path can be opened.
    pub fn open(
        &mut self,
        path: PathBuf,
        worker: &Worker,
        snapshot: &Snapshot,
        waker: &Waker,
        check: impl FnOnce(&Path) -> Result<(), PathProblem> + Send + 'static,
    ) {
        let asks = self.pending.is_none() && snapshot.has_training_to_lose();
        let checked = path.clone();
        let job = || Job::start_waking("path check", waker.clone(), move || check(&checked)).ok();
        match asks.then(job).flatten() {
            Some(job) => self.checking = Some((path, job)),
            None => self.send(order_to_open(path), worker, snapshot),
        }
    }

    fn take_path_check(&mut self, worker: &Worker, ui: &Ui, snapshot: &Snapshot) {
        let Some((path, checked)) = take_finished(&mut self.checking) else {
            // Opening names a drive that does not respond, and can be cancelled.
            let slow = self.checking.take_if(|(_, job)| job.elapsed() >= LONGEST_CHECK);
            if let Some((path, _)) = slow {
                self.send(order_to_open(path), worker, snapshot);
            } else if self.checking.is_some() {
                ui.ctx().request_repaint_after(LONGEST_CHECK);
            }
            return;
        };
        let said = |panic: PanicReport| {
            format!("{}: {}", path.display(), panic.failure_notice("checking this path")).into()
        };
        match checked.map_err(said).flatten() {
            Ok(()) => self.send(order_to_open(path), worker, snapshot),
            Err(problem) => worker.send(WorkerOrder::Refuse(path, problem)),
        }
    }

    /// Sends the order at once if no training would be lost, otherwise after confirmation.
    pub fn send(&mut self, order: WorkerOrder, worker: &Worker, snapshot: &Snapshot) {
        match &mut self.pending {
            // The user already confirmed or is about to name a file; only the following action changes.
            Some((_, next)) => *next = Continuation::Send(order),
            None if snapshot.has_training_to_lose() => {
                self.pending = Some((Stage::Decision, Continuation::Send(order)));
            }
            None => worker.send(order),
        }
    }

    /// Returns a number that identifies the file to be written next. A pending action that waited for a
    /// file name now waits until this file is written.
    pub fn begin_write(&mut self, worker: &Worker) -> u64 {
        // A number, not the path: the snapshot may still report an earlier file of the same name.
        let number = worker.new_number();
        self.advance(Stage::Name, Stage::File(number));
        number
    }

    /// Cancels the pending action if it waits for a file name.
    pub fn cancel_naming(&mut self) {
        self.pending.take_if(|(stage, _)| *stage == Stage::Name);
    }

    fn advance(&mut self, from: Stage, to: Stage) {
        if let Some((stage, _)) = self.pending.as_mut().filter(|(stage, _)| *stage == from) {
            *stage = to;
        }
    }

    /// Closes the window without confirmation.
    pub fn close(&mut self, ctx: &Context) {
        // The command returns as a close request, which must not be confirmed again.
        self.may_close = true;
        ctx.send_viewport_cmd(ViewportCommand::Close);
    }

    /// Handles a request to close the window. If training is unsaved, the window stays open until the
    /// user confirms.
    pub fn handle_close_request(&mut self, ctx: &Context, snapshot: &Snapshot) {
        if snapshot.is_terminated && !self.may_close {
            // The program is terminated from outside, so no confirmation is possible.
            self.close(ctx);
        }
        let asked = ctx.input(|i| i.viewport().close_requested());
        if !asked || self.may_close {
            return;
        }
        if self.pending.is_none() && !snapshot.has_training_to_lose() {
            return;
        }
        // Must be sent in this pass: eframe closes unless it finds this command in the same pass.
        ctx.send_viewport_cmd(ViewportCommand::CancelClose);
        if ctx.input(|i| i.viewport().minimized == Some(true)) {
            // A minimised window, closed from the task bar, would hide the confirmation.
            ctx.send_viewport_cmd(ViewportCommand::Minimized(false));
            ctx.send_viewport_cmd(ViewportCommand::Focus);
        }
        // A pending confirmation or file now leads to closing, so that the same training is not confirmed
        // twice.
        let stage = self.pending.take().map_or(Stage::Decision, |(stage, _)| stage);
        self.pending = Some((stage, Continuation::Close));
    }

    /// Prompts about unsaved training, and executes the pending action once it is allowed.
    pub fn resolve(
        &mut self,
        dialogs: &mut Dialogs,
        worker: &Worker,
        ui: &Ui,
        snapshot: &Snapshot,
    ) {
        self.take_path_check(worker, ui, snapshot);
        let Some((stage, _)) = &self.pending else { return };
        match *stage {
            Stage::Decision => match confirm_discard(ui, snapshot, self.purpose()) {
                None => {}
                Some(Decision::Discard) => self.execute(worker, ui),
                Some(Decision::Save) => {
                    self.advance(Stage::Decision, Stage::Name);
                    dialogs.save.show();
                }
                Some(Decision::Export) => {
                    self.advance(Stage::Decision, Stage::Name);
                    dialogs.export.show();
                }
                Some(Decision::Cancel) => self.pending = None,
            },
            Stage::Name => {}
            Stage::File(number) => {
                match snapshot.files.latest_write.filter(|latest| latest.number == number) {
                    Some(outcome) if outcome.is_written => self.execute(worker, ui),
                    // The dialog is open again.
                    Some(_)
                        if snapshot.files.failed_write.as_ref().is_some_and(|f| f.0 == number) =>
                    {
                        self.advance(Stage::File(number), Stage::Name);
                    }
                    // Without the file the action would discard the training after all.
                    Some(_) => self.pending = None,
                    None => self.wait_for_file(worker, ui),
                }
            }
        }
    }

    /// Returns what the pending action does, for the question about discarding.
    fn purpose(&self) -> String {
        match &self.pending {
            Some((_, Continuation::Close)) => "close the window".to_owned(),
            Some((_, Continuation::Send(order))) => match order {
                WorkerOrder::Open(Subject::Demo) => "open the demo".to_owned(),
                WorkerOrder::Open(Subject::Path(path)) => {
                    let name = path.file_name().unwrap_or(path.as_os_str());
                    format!("open “{}”", name.to_string_lossy())
                }
                WorkerOrder::Reset => "start over".to_owned(),
                WorkerOrder::Calibrate(_) => "train with this calibration".to_owned(),
                _ => "go on".to_owned(),
            },
            None => String::new(),
        }
    }

    fn wait_for_file(&mut self, worker: &Worker, ui: &Ui) {
        let exported = worker.file_progress();
        if writing_dialog(ui, exported) {
            // Only exports can be cancelled; a checkpoint is still written.
            if exported.is_some() {
                worker.cancel_file();
            }
            self.pending = None;
        }
    }

    fn execute(&mut self, worker: &Worker, ui: &Ui) {
        match self.pending.take() {
            None => {}
            Some((_, Continuation::Send(order))) => worker.send(order),
            Some((_, Continuation::Close)) => self.close(ui.ctx()),
        }
    }
}

/// Returns the [`WorkerOrder`] for a path: applies a calibration file to the open dataset, and opens any
/// other path.
pub(super) fn order_to_open(path: PathBuf) -> WorkerOrder {
    match is_calibration(&path) {
        true => WorkerOrder::Calibrate(path),
        false => WorkerOrder::Open(Subject::Path(path)),
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Decision {
    Discard,
    Save,
    Export,
    Cancel,
}

/// Draws a dialog that offers to discard unsaved training for the sake of `purpose`. Returns the user's
/// decision; `None` until there is one.
fn confirm_discard(ui: &Ui, snapshot: &Snapshot, purpose: String) -> Option<Decision> {
    let mut decision = None;
    let response = Modal::new(Id::unique("discard")).show(ui.ctx(), |ui| {
        let name = snapshot.opened.as_ref().map_or("this scene", |opened| opened.name.as_str());
        ui.heading(format!("Discard “{name}” to {purpose}?"));
        let n = snapshot.files.unsaved_frames;
        let (frames, are) = (wording::count(n, "trained frame"), if n == 1 { "is" } else { "are" });
        ui.label(match n {
            0 => "Scale, level or coordinates are neither saved nor exported.".to_owned(),
            _ => format!("{frames} {are} neither saved nor exported."),
        });
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
    // Escape, or a click beside the prompt.
    if response.should_close() {
        decision = decision.or(Some(Decision::Cancel));
    }
    decision
}

/// Draws a progress dialog while an action waits until a file is written. `exported` is the written
/// fraction of an export. Returns true if the user cancels.
fn writing_dialog(ui: &Ui, exported: Option<f32>) -> bool {
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

pub(super) fn help(ui: &Ui, is_open: &mut bool) {
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

/// Draws the window with version, graphics adapter and manual.
pub(super) fn about(ui: &Ui, is_open: &mut bool, adapter: &str) {
    let window = Window::new("About").open(is_open).collapsible(false).resizable(false);
    window.show(ui.ctx(), |ui| {
        ui.label(RichText::new("VBGS Studio").size(22.0).strong());
        ui.label(format!("Version {}", env!("CARGO_PKG_VERSION")));
        ui.label(env!("CARGO_PKG_DESCRIPTION"));
        ui.label(format!("Licence: {}", env!("CARGO_PKG_LICENSE")));
        ui.add_space(6.0);
        ui.label(RichText::new(adapter).weak());
        ui.add_space(6.0);
        ui.label("Manual: the folder docs beside the program's source, or vbgs-studio --help");
    });
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
