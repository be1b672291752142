//! The bar at the top: transport buttons, name, progress, detail.

use super::detail;
use crate::app::command::UiCommand;
use crate::app::state::{RunState, Snapshot};
use crate::train::scene::units::StructuralScale;
use eframe::egui::{Button, ProgressBar, RichText, Ui};
use std::path::PathBuf;

/// Buttons in the order they stand.
const BUTTONS: [&[UiCommand]; 3] = [
    &[UiCommand::Open, UiCommand::OpenDemo, UiCommand::Save, UiCommand::Export],
    &[UiCommand::Train, UiCommand::Step, UiCommand::Follow, UiCommand::Reset],
    &[UiCommand::FrameScene, UiCommand::Home, UiCommand::Help],
];

/// What the user asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TransportAnswer {
    /// A command.
    Command(UiCommand),
    /// Something that was open before.
    Open(PathBuf),
    /// The same frames again, as fine as is chosen now.
    Again,
}

/// Draws the bar. `scale` is the structural scale of the next run, `None` as the one that is open has it.
pub fn ui(
    snapshot: &Snapshot,
    recent: &[PathBuf],
    scale: &mut Option<StructuralScale>,
    ui: &mut Ui,
) -> Option<TransportAnswer> {
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
                    asked = Some(TransportAnswer::Command(command));
                }
                if command == UiCommand::Open
                    && let Some(path) = reopen(snapshot, recent, ui)
                {
                    asked = Some(TransportAnswer::Open(path));
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
        if detail::ui(scale, snapshot, ui) {
            asked = Some(TransportAnswer::Again);
        }
    });
    asked
}

/// The menu of what was open before.
fn reopen(snapshot: &Snapshot, recent: &[PathBuf], ui: &mut Ui) -> Option<PathBuf> {
    let mut asked = None;
    let is_legal = UiCommand::Open.is_legal(snapshot.state, snapshot.source) && !recent.is_empty();
    ui.add_enabled_ui(is_legal, |ui| {
        ui.menu_button("Recent", |ui| {
            for path in recent {
                if ui.button(path.display().to_string()).clicked() {
                    asked = Some(path.clone());
                    ui.close();
                }
            }
        })
        .response
        .on_hover_text("Open again what was open before");
    });
    asked
}

fn button(snapshot: &Snapshot, ui: &mut Ui, command: UiCommand) -> bool {
    let legal = command.is_legal(snapshot.state, snapshot.source);
    let is_on = command == UiCommand::Follow && snapshot.follows;
    let response = ui.add_enabled(legal, Button::new(command.label()).selected(is_on));
    response.on_hover_text(command.hint(ui.ctx())).clicked()
}
