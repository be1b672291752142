//! Dialogs for one path: a text field, and a native dialog if there is one.
//!
//! The field always works, while native dialogs need a desktop portal. A native dialog itself prompts
//! before a file is replaced; for the field, this module does. The path is checked on a separate thread,
//! because a drive that does not respond must not block the window. A dialog stays open, with what was
//! typed, until its path passes the check.

use super::opening::{FileProposal, PathProblem, absolute_or_same};
use super::panels::controls::{choices, named, optional_number};
use super::panels::notices::OPEN_ABOVE;
use super::worker::Waker;
use crate::dataset::{LoadOptions, PoseConvention};
use crate::export::format::{READ_ENDINGS, WRITTEN_ENDINGS, listed};
use crate::export::video::is_video;
use crate::pipeline::job::Job;
use eframe::egui::{
    Align2, Button, CollapsingHeader, ComboBox, DragValue, Grid, Id, Key, Modal, RichText,
    TextEdit, Ui, Window,
};
use std::path::{Path, PathBuf};
use std::time::Duration;
use strum::{EnumMessage, IntoEnumIterator};

/// Offset of the export dialog from the upper right corner of the window, points. The dialog leaves most
/// of the picture visible.
const ASIDE: [f32; 2] = [-8.0, 72.0];

/// Replaces a leading `~` in a path by the user's home folder.
fn at_home(path: &Path, home: Option<PathBuf>) -> PathBuf {
    // Shells expand it, but a typed or pasted path has passed through none.
    match (path.strip_prefix("~"), home) {
        (Ok(rest), Some(home)) => home.join(rest),
        _ => path.to_owned(),
    }
}

#[derive(Clone, Copy, Default, PartialEq, Eq)]
pub enum Purpose {
    #[default]
    Open,
    Compare,
    Save,
    Export,
    Film,
    Picture,
}

impl Purpose {
    /// Returns the title of the dialog, which is also the label of its button.
    fn label(self) -> &'static str {
        match self {
            Purpose::Open => "Open",
            Purpose::Compare => "Compare",
            Purpose::Save => "Save",
            Purpose::Export => "Export",
            Purpose::Film => "Render film",
            Purpose::Picture => "Save picture",
        }
    }

    fn hint(self) -> String {
        match self {
            Purpose::Open => format!(
                "A dataset folder, a checkpoint, a calibration or splats ({})",
                listed(&READ_ENDINGS)
            ),
            Purpose::Compare => format!(
                "A second model in the scene's world: a checkpoint or splats ({})",
                listed(&READ_ENDINGS)
            ),
            Purpose::Save => "A file name ending in .vbgs".to_owned(),
            Purpose::Export => format!("A file name ending in {}", listed(&WRITTEN_ENDINGS)),
            Purpose::Film => {
                "A folder for PNG images, a .gif, or a video encoded by ffmpeg: .mp4, .webm or .webp"
                    .to_owned()
            }
            Purpose::Picture => "A file name ending in .png".to_owned(),
        }
    }

    fn writes(self) -> bool {
        !matches!(self, Purpose::Open | Purpose::Compare)
    }

    /// Returns the extension of the proposed file; `None` for dialogs that open a file.
    fn ending(self) -> Option<&'static str> {
        match self {
            Purpose::Open | Purpose::Compare => None,
            Purpose::Save => Some("vbgs"),
            Purpose::Export => Some(WRITTEN_ENDINGS[0]),
            Purpose::Film => Some("film"),
            Purpose::Picture => Some("view.png"),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PathAnswer {
    Path(PathBuf),
    Cancelled,
}

#[derive(Default)]
pub struct PathDialog {
    purpose: Purpose,
    is_open: bool,
    path: String,
    /// Serial number of the dataset or model for which the path was proposed.
    proposed_for: u64,
    /// Native dialog in progress. It runs on its own thread, so that the window keeps drawing.
    native: Option<Job<Option<PathBuf>>>,
    no_native: bool,
    /// Path of a file whose replacement the user has confirmed in a native dialog.
    approved: Option<PathBuf>,
    /// Entered path, and the job that checks what exists there.
    checking: Option<(PathBuf, Job<Result<Occupant, PathProblem>>)>,
    /// Existing file or folder whose replacement the user must confirm.
    replacing: Option<(PathBuf, Occupant)>,
    problem: Option<PathProblem>,
    /// True if the text field must receive the focus, because the dialog was just opened.
    takes_focus: bool,
}

/// Draws the options with which a dataset is read, folded unless one is set.
pub fn reading(options: &mut LoadOptions, ui: &mut Ui) {
    let is_changed = *options != LoadOptions::default();
    let section = CollapsingHeader::new("Open as…").id_salt("reading").default_open(is_changed);
    section.show(ui, |ui| {
        Grid::new("reading").num_columns(2).show(ui, |ui| {
            ui.label("Poses");
            let sources = [
                (false, "Recorded", "Poses of the recording"),
                (
                    true,
                    "Tracked",
                    "Tracks the camera against the scene; the first frame is the origin",
                ),
            ];
            ui.horizontal(|ui| choices(&mut options.track, &sources, ui));
            ui.end_row();
            let name = ui.label("Pose axes");
            let shown = options.poses.map_or("of the layout", PoseConvention::name);
            let axes = ComboBox::from_id_salt("axes").selected_text(shown);
            let axes = axes.show_ui(ui, |ui| {
                ui.selectable_value(&mut options.poses, None, "of the layout");
                for convention in PoseConvention::iter() {
                    let entry = ui.selectable_value(
                        &mut options.poses,
                        Some(convention),
                        convention.name(),
                    );
                    entry.on_hover_text(convention.get_documentation().unwrap_or_default());
                }
            });
            axes.response.labelled_by(name.id);
            ui.end_row();
            ui.label("Depth unit");
            let texts = [
                "set",
                "World units per step of 16-bit depth: 0.001 for millimetres",
                "Depth unit",
                "",
            ];
            optional_number(&mut options.depth_scale, 0.001, 1e-6..=10.0, texts, ui);
            ui.end_row();
            ui.label("Confidence");
            let texts = [
                "set",
                "Minimum confidence of depth, for sensors that record it",
                "Confidence",
                "",
            ];
            optional_number(&mut options.confidence, 1, 0..=2, texts, ui);
            ui.end_row();
            ui.label("Depth range");
            numbers(&mut options.depth_range, [0.2, 5.0], ["Nearest", "Farthest"], ui);
            ui.end_row();
            ui.label("Intrinsics");
            numbers(
                &mut options.intrinsics,
                [500.0, 500.0, 320.0, 240.0],
                ["fx", "fy", "cx", "cy"],
                ui,
            );
            ui.end_row();
        });
        ui.checkbox(&mut options.geometry_only, "Geometry only")
            .on_hover_text("Opens recordings whose photographs cannot be decoded, in grey");
    });
}

/// Draws some numbers and a checkbox that switches all of them on.
fn numbers<const N: usize>(
    values: &mut Option<[f64; N]>,
    default: [f64; N],
    names: [&str; N],
    ui: &mut Ui,
) {
    ui.horizontal(|ui| {
        let mut is_on = values.is_some();
        if ui.checkbox(&mut is_on, "set").changed() {
            *values = is_on.then_some(default);
        }
        let mut shown = values.unwrap_or(default);
        for (value, name) in shown.iter_mut().zip(names) {
            let number = DragValue::new(value).range(0.0..=1e6).prefix(format!("{name} "));
            named(ui.add_enabled(is_on, number), name);
        }
        if is_on {
            *values = Some(shown);
        }
    });
}

impl PathDialog {
    pub fn new(purpose: Purpose) -> Self {
        Self { purpose, ..Self::default() }
    }

    pub fn is_open(&self) -> bool {
        self.is_open
    }

    pub fn show(&mut self) {
        self.is_open = true;
        self.takes_focus = true;
    }

    /// Shows the dialog again, because its path could not be used after all.
    pub fn show_problem(&mut self, problem: impl Into<PathProblem>) {
        self.show();
        self.problem = Some(problem.into());
    }

    /// Shows the dialog with a path.
    pub fn show_path(&mut self, path: &Path) {
        self.show();
        self.path = path.display().to_string();
    }

    /// Proposes a file for the open dataset or model, which has the serial number `serial`. The user's own
    /// input is kept until another dataset or model is opened.
    pub fn propose(&mut self, serial: u64, files: &FileProposal) {
        let Some(ending) = self.purpose.ending().filter(|_| self.proposed_for != serial) else {
            return;
        };
        self.proposed_for = serial;
        self.path = files.path(ending).display().to_string();
        (self.approved, self.replacing, self.problem) = (None, None, None);
    }

    /// Draws the dialog. `choices` draws further controls in it. `below` draws content under the buttons,
    /// where it may appear later without moving them. `check` is applied to a confirmed path. Returns the
    /// path once it has passed, or the cancellation.
    pub fn ui(
        &mut self,
        ui: &Ui,
        waker: &Waker,
        check: impl FnOnce(&Path) -> Result<(), PathProblem> + Send + 'static,
        choices: impl FnOnce(&mut Ui),
        below: impl FnOnce(&mut Ui),
    ) -> Option<PathAnswer> {
        if !self.is_open {
            return None;
        }
        self.take_picked();
        let mut stays = true;
        let mut confirmed = false;
        let (anchor, offset) = match self.purpose {
            // An export shows its preview in the picture, so its dialog does not cover that.
            Purpose::Export => (Align2::RIGHT_TOP, ASIDE),
            _ => (Align2::CENTER_CENTER, [0.0, 0.0]),
        };
        Window::new(self.purpose.label())
            .open(&mut stays)
            .collapsible(false)
            .resizable(false)
            .anchor(anchor, offset)
            .show(ui.ctx(), |ui| {
                confirmed = self.content(ui, waker, choices);
                below(ui);
                // Below everything else, because it appears later: buttons must not move under the
                // pointer.
                if let Some((path, job)) = &self.checking {
                    show_waiting(path, job.elapsed(), ui);
                }
            });
        if let Some(answer) = self.take_path_check() {
            return Some(answer);
        }
        // Drawn instead of the dialog, so that the prompt's Escape does not close the dialog as well.
        if self.replacing.is_some() {
            return self.prompt_replacement(ui);
        }
        if confirmed {
            self.confirm(waker, check);
            return None;
        }
        if !stays || ui.input(|i| i.key_pressed(Key::Escape)) {
            // A check in progress must not answer for a closed dialog.
            (self.is_open, self.checking, self.problem) = (false, None, None);
            return Some(PathAnswer::Cancelled);
        }
        None
    }

    /// Returns the entered path, made absolute.
    pub fn entered(&self) -> PathBuf {
        let path = at_home(Path::new(self.path.trim()), std::env::home_dir());
        absolute_or_same(&path)
    }

    /// Starts to check the entered path on a separate thread.
    fn confirm(
        &mut self,
        waker: &Waker,
        check: impl FnOnce(&Path) -> Result<(), PathProblem> + Send + 'static,
    ) {
        let (path, purpose) = (self.entered(), self.purpose);
        let checked = path.clone();
        let look = move || {
            let occupant = Occupant::of(&checked);
            if purpose.writes() {
                check_place(&checked, occupant, purpose)?;
            }
            check(&checked)?;
            Ok(occupant)
        };
        match Job::start_waking("dialog", waker.clone(), look) {
            Ok(job) => self.checking = Some((path, job)),
            Err(error) => {
                let path = path.display();
                let text = format!(
                    "{path}: starting the thread that checks this path failed: {error}; try again"
                );
                self.problem = Some(text.into());
            }
        }
    }

    /// Handles the result of the path check, if it is available: returns the path, or prompts before an
    /// existing file is replaced.
    fn take_path_check(&mut self) -> Option<PathAnswer> {
        let (_, job) = self.checking.as_ref()?;
        let looked = job.poll()?;
        let (path, _) = self.checking.take()?;
        // The user has entered another path meanwhile.
        if path != self.entered() {
            return None;
        }
        match looked {
            Err(panic) => {
                let said = panic.failure_notice("checking this path");
                self.problem = Some(format!("{}: {said}", path.display()).into());
            }
            Ok(Err(problem)) => self.problem = Some(problem),
            Ok(Ok(occupant)) => {
                let exists = self.purpose.writes() && occupant != Occupant::Nothing;
                if !exists || self.approved.as_ref() == Some(&path) {
                    return Some(self.answer(path));
                }
                self.replacing = Some((path, occupant));
            }
        }
        None
    }

    fn answer(&mut self, path: PathBuf) -> PathAnswer {
        self.is_open = false;
        // By the next time the file exists, so its replacement must be confirmed again.
        (self.approved, self.replacing, self.problem) = (None, None, None);
        self.checking = None;
        PathAnswer::Path(path)
    }

    fn prompt_replacement(&mut self, ui: &Ui) -> Option<PathAnswer> {
        let (path, occupant) = self.replacing.clone()?;
        let (mut replace, mut keep) = (false, false);
        let response = Modal::new(Id::unique("replace")).show(ui.ctx(), |ui| {
            ui.heading(match occupant {
                Occupant::Folder => "Replace the pictures in this folder?",
                Occupant::File | Occupant::Nothing => "Replace the existing file?",
            });
            ui.label(format!("{} already exists.", path.display()));
            ui.add_space(8.0);
            ui.horizontal(|ui| {
                replace = ui.button("Replace").clicked();
                keep = ui.button("Choose another name").clicked();
            });
        });
        if replace {
            return Some(self.answer(path));
        }
        // Escape, or a click beside the prompt.
        if keep || response.should_close() {
            self.replacing = None;
        }
        None
    }

    fn content(&mut self, ui: &mut Ui, waker: &Waker, choices: impl FnOnce(&mut Ui)) -> bool {
        ui.label(self.purpose.hint());
        let field = TextEdit::singleline(&mut self.path).desired_width(420.0).hint_text("path");
        let field = named(ui.add(field), "Path");
        if std::mem::take(&mut self.takes_focus) {
            field.request_focus();
            tracing::debug!("shown: a dialog for a path");
        }
        if field.changed() {
            self.problem = None;
        }
        // Enter takes the focus from a single-line field, so it can only be detected here.
        let mut confirmed = field.lost_focus() && ui.input(|i| i.key_pressed(Key::Enter));
        if self.purpose.writes()
            && let Some(folder) = self.entered().parent()
        {
            ui.label(RichText::new(format!("Folder: {}", folder.display())).weak());
        }
        if let Some(PathProblem { text, above }) = self.problem.clone() {
            ui.colored_label(ui.visuals().error_fg_color, text);
            if let Some(above) = above
                && ui.button(OPEN_ABOVE).clicked()
            {
                (self.path, self.problem) = (above.display().to_string(), None);
                confirmed = true;
            }
        }
        choices(ui);
        ui.horizontal(|ui| {
            confirmed |= ui.button(self.purpose.label()).clicked();
            self.native_dialogs(ui, waker);
        });
        if self.no_native {
            ui.label(
                RichText::new("The system dialog returned no path: type the path above.").weak(),
            );
        }
        confirmed && !self.path.trim().is_empty()
    }

    fn native_dialogs(&mut self, ui: &mut Ui, waker: &Waker) {
        let entered = self.entered();
        let mut dialog = rfd::FileDialog::new();
        if let (Some(folder), true) = (entered.parent(), self.purpose.writes()) {
            dialog = dialog.set_directory(folder);
        }
        if let (Some(name), true) = (entered.file_name(), self.purpose.writes()) {
            dialog = dialog.set_file_name(name.to_string_lossy());
        }
        match self.purpose {
            Purpose::Open => {
                let folders = dialog.clone();
                self.browse(ui, waker, "Browse folders…", || folders.pick_folder());
                let endings = [&["vbgs", "ron"], &READ_ENDINGS[..]].concat();
                let files = dialog.add_filter("models and calibrations", &endings);
                self.browse(ui, waker, "Browse files…", || files.pick_file());
            }
            Purpose::Compare => {
                let endings = [&["vbgs"], &READ_ENDINGS[..]].concat();
                let files = dialog.add_filter("models", &endings);
                self.browse(ui, waker, "Browse…", || files.pick_file());
            }
            Purpose::Save => {
                let files = dialog.add_filter("checkpoints", &["vbgs"]);
                self.browse(ui, waker, "Browse…", || files.save_file());
            }
            Purpose::Film => {
                let folders = dialog.clone();
                self.browse(ui, waker, "Browse folders…", || folders.pick_folder());
                let files = dialog.add_filter("films", &["gif", "mp4", "webm", "webp"]);
                self.browse(ui, waker, "Browse files…", || files.save_file());
            }
            Purpose::Picture => {
                let files = dialog.add_filter("pictures", &["png"]);
                self.browse(ui, waker, "Browse…", || files.save_file());
            }
            Purpose::Export => {
                let files = dialog.add_filter("splats", &WRITTEN_ENDINGS);
                self.browse(ui, waker, "Browse…", || files.save_file());
            }
        }
    }

    fn browse(
        &mut self,
        ui: &mut Ui,
        waker: &Waker,
        label: &str,
        pick: impl FnOnce() -> Option<PathBuf> + Send + 'static,
    ) {
        if ui.add_enabled(self.native.is_none(), Button::new(label)).clicked() {
            // Without a thread the field still works.
            self.native = Job::start_waking("dialog", waker.clone(), pick).ok();
        }
    }

    fn take_picked(&mut self) {
        let Some(answer) = self.native.as_ref().and_then(Job::poll) else { return };
        self.native = None;
        // A cancelled dialog, a missing portal and a panic have the same result, so the hint covers all
        // of them.
        let picked = answer.ok().flatten();
        self.no_native = picked.is_none();
        if let Some(path) = picked {
            self.path = path.display().to_string();
            self.problem = None;
            // In the form that `confirm` compares: absolute, and through the text field.
            self.approved = Some(self.entered());
        }
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Occupant {
    Nothing,
    /// A file or link that would be replaced.
    File,
    Folder,
}

/// Checks that a file, or a film in place of one, can be written at a path.
fn check_place(path: &Path, occupant: Occupant, purpose: Purpose) -> Result<(), PathProblem> {
    // Pictures of a film are written into a folder, which may exist or is created.
    if purpose == Purpose::Film && !is_video(path) {
        return Ok(());
    }
    if occupant == Occupant::Folder {
        return Err(format!("{} is a folder: add the name of a file", path.display()).into());
    }
    match path.parent().filter(|folder| !folder.is_dir()) {
        None => Ok(()),
        Some(folder) => {
            let folder = folder.display();
            let text =
                format!("{folder}: found no folder, expected one to write to; choose another");
            Err(text.into())
        }
    }
}

/// Time after which a dialog reports that it waits for a drive. Drives that respond take less time.
const HINT_DELAY: Duration = Duration::from_secs(1);

impl Occupant {
    fn of(path: &Path) -> Self {
        // A dangling link counts as a file, because it would be replaced.
        match (path.is_dir(), path.symlink_metadata().is_ok()) {
            (true, _) => Self::Folder,
            (false, true) => Self::File,
            (false, false) => Self::Nothing,
        }
    }
}

/// Draws a message about the drive if checking `path` takes long.
fn show_waiting(path: &Path, elapsed: Duration, ui: &mut Ui) {
    match HINT_DELAY.checked_sub(elapsed) {
        Some(rest) => ui.ctx().request_repaint_after(rest),
        None => {
            let folder = path.parent().unwrap_or(path).display();
            ui.label(format!(
                "{folder}: the drive has not responded yet; wait, or choose another folder"
            ));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tilde_is_the_users_folder_and_only_as_a_whole_part() {
        let home = || Some(PathBuf::from("/home/ada"));
        let found = |path: &str| at_home(Path::new(path), home());
        assert_eq!(found("~/rooms/a b"), Path::new("/home/ada/rooms/a b"));
        assert_eq!(found("~"), Path::new("/home/ada"));
        for same in ["~ada/room", "/data/~", "room~"] {
            assert_eq!(found(same), Path::new(same));
        }
        assert_eq!(at_home(Path::new("~/room"), None), Path::new("~/room"));
    }

    #[test]
    fn files_folders_and_links_to_nowhere_are_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.ply");
        assert_eq!(Occupant::of(&file), Occupant::Nothing);
        std::fs::write(&file, "").unwrap();
        assert_eq!(Occupant::of(&file), Occupant::File);
        assert_eq!(Occupant::of(folder.path()), Occupant::Folder);
        #[cfg(unix)]
        {
            let link = folder.path().join("link.ply");
            std::os::unix::fs::symlink(folder.path().join("gone"), &link).unwrap();
            assert_eq!(Occupant::of(&link), Occupant::File);
        }
    }
}
