//! The bar at the top: name, transport buttons, progress.

use crate::app::command::UiCommand;
use crate::app::state::{RunState, Snapshot};
use eframe::egui::{Button, ProgressBar, RichText, Ui};

/// Buttons in the order they stand.
const BUTTONS: [&[UiCommand]; 3] = [
    &[UiCommand::Open, UiCommand::OpenDemo, UiCommand::Save, UiCommand::Export],
    &[UiCommand::Train, UiCommand::Step, UiCommand::Follow, UiCommand::Reset],
    &[UiCommand::FrameScene, UiCommand::Home, UiCommand::Help],
];

/// Draws the bar.
pub fn ui(snapshot: &Snapshot, ui: &mut Ui) -> Option<UiCommand> {
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        for (i, group) in BUTTONS.iter().enumerate() {
            if i > 0 {
                ui.separator();
            }
            for &command in *group {
                // Train and Pause share one place.
                let command = match (command, snapshot.state) {
                    (UiCommand::Train, RunState::Training) => UiCommand::Pause,
                    (other, _) => other,
                };
                if button(snapshot, ui, command) {
                    asked = Some(command);
                }
            }
        }
        if let Some(opened) = &snapshot.opened {
            ui.separator();
            ui.label(RichText::new(&opened.name).strong());
        }
        if snapshot.n_frames > 0 {
            let share = snapshot.frames_done as f32 / snapshot.n_frames as f32;
            let text = format!("{} / {}", snapshot.frames_done, snapshot.n_frames);
            ui.add(ProgressBar::new(share).desired_width(160.0).text(text));
        }
        if matches!(snapshot.state, RunState::Loading | RunState::Waiting) {
            ui.spinner();
        }
    });
    asked
}

fn button(snapshot: &Snapshot, ui: &mut Ui, command: UiCommand) -> bool {
    let legal = command.is_legal(snapshot.state, snapshot.source);
    let is_on = command == UiCommand::Follow && snapshot.follows;
    let response = ui.add_enabled(legal, Button::new(command.label()).selected(is_on));
    response.on_hover_text(command.hint(ui.ctx())).clicked()
}
