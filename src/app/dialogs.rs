//! Windows that ask: what to open, where to save and export, whether to discard, and the list of shortcuts.
//! Every file can be named by a path field too, since native dialogs need a desktop portal.

use super::command::Command;
use super::worker::Waker;
use eframe::egui::{Align2, Grid, Id, Key, Modal, RichText, TextEdit, Ui, Window};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};

/// A native dialog running on its own thread.
struct Picker(Receiver<Option<PathBuf>>);

impl Picker {
    fn start(
        waker: &Waker,
        pick: impl FnOnce() -> Option<PathBuf> + Send + 'static,
    ) -> Option<Self> {
        let (sender, receiver) = channel();
        let waker = waker.clone();
        let thread = std::thread::Builder::new().name("dialog".into()).spawn(move || {
            // The window may be gone when the user is done.
            let _ = sender.send(pick());
            waker();
        });
        thread.is_ok().then_some(Self(receiver))
    }
}

/// What a path is asked for.
#[derive(Clone, Copy)]
enum Purpose {
    Open,
    Save,
    Export,
}

impl Purpose {
    /// Title of the dialog and text of its button.
    fn label(self) -> &'static str {
        match self {
            Purpose::Open => "Open",
            Purpose::Save => "Save",
            Purpose::Export => "Export",
        }
    }

    fn hint(self) -> &'static str {
        match self {
            Purpose::Open => "A dataset folder, a checkpoint, a .ply, a .glb or a calibration",
            Purpose::Save => "A file name ending in .vbgs",
            Purpose::Export => "A file name ending in .ply or .glb",
        }
    }
}

/// Dialog for one path: a text field, and a native dialog where there is one.
pub struct PathDialog {
    purpose: Purpose,
    is_open: bool,
    path: String,
    picker: Option<Picker>,
    no_native: bool,
}

impl PathDialog {
    /// What to open.
    pub fn open() -> Self {
        Self::new(Purpose::Open, "")
    }

    /// Where to save a checkpoint.
    pub fn save() -> Self {
        Self::new(Purpose::Save, "checkpoint.vbgs")
    }

    /// Where to export.
    pub fn export() -> Self {
        Self::new(Purpose::Export, "scene.ply")
    }

    fn new(purpose: Purpose, path: &str) -> Self {
        Self { purpose, is_open: false, path: path.to_owned(), picker: None, no_native: false }
    }

    /// Whether it is shown.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Shows the dialog from now on.
    pub fn show(&mut self) {
        self.is_open = true;
    }

    /// Draws the dialog with further `choices`; the path once the user confirmed it.
    pub fn ui(&mut self, ui: &Ui, waker: &Waker, choices: impl FnOnce(&mut Ui)) -> Option<PathBuf> {
        if !self.is_open {
            return None;
        }
        self.take_picked();
        let mut stays = true;
        let mut confirmed = false;
        Window::new(self.purpose.label())
            .open(&mut stays)
            .collapsible(false)
            .resizable(false)
            .anchor(Align2::CENTER_CENTER, [0.0, 0.0])
            .show(ui.ctx(), |ui| confirmed = self.content(ui, waker, choices));
        if ui.input(|i| i.key_pressed(Key::Escape)) {
            stays = false;
        }
        self.is_open = stays && !confirmed;
        confirmed.then(|| PathBuf::from(self.path.trim()))
    }

    fn content(&mut self, ui: &mut Ui, waker: &Waker, choices: impl FnOnce(&mut Ui)) -> bool {
        ui.label(self.purpose.hint());
        let field =
            ui.add(TextEdit::singleline(&mut self.path).desired_width(420.0).hint_text("path"));
        let entered = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
        let mut confirmed = entered;
        choices(ui);
        ui.horizontal(|ui| {
            confirmed |= ui.button(self.purpose.label()).clicked();
            match self.purpose {
                Purpose::Open => {
                    self.browse(ui, waker, "Browse folders…", || {
                        rfd::FileDialog::new().pick_folder()
                    });
                    self.browse(ui, waker, "Browse files…", || {
                        rfd::FileDialog::new()
                            .add_filter(
                                "models and calibrations",
                                &["vbgs", "ply", "glb", "gltf", "ron"],
                            )
                            .pick_file()
                    });
                }
                Purpose::Save => self.browse(ui, waker, "Browse…", || {
                    rfd::FileDialog::new()
                        .add_filter("checkpoints", &["vbgs"])
                        .set_file_name("checkpoint.vbgs")
                        .save_file()
                }),
                Purpose::Export => self.browse(ui, waker, "Browse…", || {
                    rfd::FileDialog::new()
                        .add_filter("splats", &["ply", "glb"])
                        .set_file_name("scene.ply")
                        .save_file()
                }),
            }
        });
        if self.no_native {
            ui.label(
                RichText::new("No path came from the system's dialog: type the path above.").weak(),
            );
        }
        confirmed && !self.path.trim().is_empty()
    }

    fn browse(
        &mut self,
        ui: &mut Ui,
        waker: &Waker,
        label: &str,
        pick: impl FnOnce() -> Option<PathBuf> + Send + 'static,
    ) {
        if ui.add_enabled(self.picker.is_none(), eframe::egui::Button::new(label)).clicked() {
            self.picker = Picker::start(waker, pick);
        }
    }

    fn take_picked(&mut self) {
        let Some(picked) = self.picker.as_ref().and_then(|p| p.0.try_recv().ok()) else { return };
        self.picker = None;
        self.no_native = picked.is_none();
        if let Some(path) = picked {
            self.path = path.display().to_string();
        }
    }
}

/// What the user decided about unsaved training.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Decision {
    /// Forget the scene.
    Discard,
    /// Save the run first.
    Save,
    /// Export the scene first.
    Export,
    /// Do nothing.
    Cancel,
}

/// Asks whether `n_frames` of training may be forgotten.
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

/// Mouse actions of the viewport, for the help window.
const MOUSE: [(&str, &str); 5] = [
    ("Left drag", "Orbit"),
    ("Right or middle drag", "Pan"),
    ("Wheel, pinch", "Dolly"),
    ("Drag a divider", "Wipe from one picture to the other"),
    ("Drop a folder or file", "Open it, or calibrate what is open by it"),
];

/// The list of shortcuts.
pub fn help(ui: &Ui, is_open: &mut bool) {
    Window::new("Shortcuts").open(is_open).collapsible(false).resizable(false).show(
        ui.ctx(),
        |ui| {
            Grid::new("shortcuts").num_columns(2).striped(true).show(ui, |ui| {
                for command in Command::ALL {
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
        },
    );
}
