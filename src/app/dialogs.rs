//! Questions about unsaved training, and the list of shortcuts.

use super::command::UiCommand;
use eframe::egui::{Grid, Id, Modal, ProgressBar, RichText, ScrollArea, Ui, Window};

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

/// Shown while a file is written on which something waits, with the share of an export that is
/// written; whether the user no longer wants that.
pub fn wait_for_file(ui: &Ui, exported: Option<f32>) -> bool {
    let response = Modal::new(Id::unique("writing")).show(ui.ctx(), |ui| {
        ui.horizontal(|ui| {
            ui.spinner();
            ui.label("Writing the file…");
        });
        ui.add_space(8.0);
        if let Some(share) = exported {
            ui.add(ProgressBar::new(share).show_percentage());
        }
        // A checkpoint takes less time than a click.
        let meaning = match exported {
            Some(_) => "No file is written, and nothing else is done",
            None => "The file is written all the same",
        };
        ui.button("Cancel").on_hover_text(meaning).clicked()
    });
    response.inner || response.should_close()
}

/// Actions of mouse and keyboard that are no commands, for the help window.
const MOUSE: [(&str, &str); 8] = [
    ("Left drag", "Orbit"),
    ("Right or middle drag", "Pan"),
    ("Wheel, pinch", "Dolly"),
    ("Double click", "Turn about this place of the surface"),
    ("W A S D, Q E", "Fly, down and up; Shift ten times faster, Ctrl ten times slower"),
    ("Drag a divider", "Wipe from one picture to the other"),
    ("Shift+Tab", "Go to the controls, where Tab leads on and Escape back to the view"),
    ("Drop a folder or file", "Open it, or calibrate what is open by it"),
];

/// Room that the title of the list of shortcuts takes, and some around it, points.
const HELP_FRAME: f32 = 60.0;

/// The list of shortcuts.
pub fn help(ui: &Ui, is_open: &mut bool) {
    let room = ui.ctx().viewport_rect().height() - HELP_FRAME;
    Window::new("Shortcuts").open(is_open).collapsible(false).resizable(false).show(
        ui.ctx(),
        |ui| {
            // All of the list where the window has room for it.
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
