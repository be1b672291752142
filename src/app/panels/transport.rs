//! Top bar: menus, transport buttons, name, progress and level of detail. One row for all leaves more room
//! for the viewport.

use super::detail;
use super::menus::{self, MenuAnswer, MenuContext};
use crate::app::command::UiCommand;
use crate::app::state::{RunState, Snapshot};
use crate::train::scene::units::StructuralScale;
use eframe::egui::{Button, ProgressBar, RichText, Ui};

/// Groups of buttons, in order.
const BUTTONS: [&[UiCommand]; 2] = [
    &[UiCommand::Open, UiCommand::OpenDemo, UiCommand::Save, UiCommand::Export],
    &[UiCommand::Train, UiCommand::Step, UiCommand::Follow, UiCommand::Reset],
];

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum TransportAnswer {
    Command(UiCommand),
    Menu(MenuAnswer),
    /// Train on the same frames with the chosen level of detail.
    Retrain,
}

/// Draws the bar. `scale` is the structural scale of the next run; `None` means that of the open run.
pub fn ui(
    snapshot: &Snapshot,
    menu: &MenuContext<'_>,
    scale: &mut Option<StructuralScale>,
    ui: &mut Ui,
) -> Option<TransportAnswer> {
    let mut asked = None;
    ui.horizontal_wrapped(|ui| {
        asked = menus::ui(menu, ui).map(TransportAnswer::Menu);
        for group in BUTTONS {
            ui.separator();
            for &command in group {
                // Train and Pause share one button.
                let command = match (command, snapshot.state) {
                    (UiCommand::Train, RunState::Training) => UiCommand::Pause,
                    (other, _) => other,
                };
                if button(snapshot, ui, command) {
                    asked = Some(TransportAnswer::Command(command));
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
            asked = Some(TransportAnswer::Retrain);
        }
    });
    asked
}

fn button(snapshot: &Snapshot, ui: &mut Ui, command: UiCommand) -> bool {
    let why_not = command.unavailable_reason(snapshot.state, snapshot.source);
    let is_on = command == UiCommand::Follow && snapshot.follows;
    let button = Button::new(command.label()).selected(is_on);
    let response = ui.add_enabled(why_not.is_none(), button);
    let response = response.on_hover_text(command.hint(ui.ctx()));
    response.on_disabled_hover_text(why_not.unwrap_or_default()).clicked()
}
