//! Confirmation dialogs for unsaved training, and the list of shortcuts.

use super::command::UiCommand;
use eframe::egui::{Grid, Id, Modal, ProgressBar, RichText, ScrollArea, Ui, Window};

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
