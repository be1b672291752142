//! Menu bar: every command with its shortcut, and the reason if it is unavailable.

use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use eframe::egui::{Button, Ui};
use std::path::PathBuf;

/// Menus of the bar. The training menu is named "Run", since "Train" is the label of a button.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Menu {
    File,
    Selection,
    View,
    Run,
    Help,
}

impl Menu {
    const ALL: [Self; 5] = [Self::File, Self::Selection, Self::View, Self::Run, Self::Help];

    fn label(self) -> &'static str {
        match self {
            Self::File => "File",
            Self::Selection => "Selection",
            Self::View => "View",
            Self::Run => "Run",
            Self::Help => "Help",
        }
    }
}

/// Menu of a command and its group there; separators divide the groups.
fn menu_and_group(command: UiCommand) -> (Menu, u8) {
    match command {
        UiCommand::Open | UiCommand::OpenDemo => (Menu::File, 0),
        UiCommand::Save | UiCommand::Export | UiCommand::SavePicture => (Menu::File, 1),
        UiCommand::Quit => (Menu::File, 2),
        UiCommand::Undo | UiCommand::Redo => (Menu::Selection, 0),
        UiCommand::BoxSelect | UiCommand::Deselect => (Menu::Selection, 1),
        UiCommand::HideSelected
        | UiCommand::ShowHidden
        | UiCommand::DeleteSelected
        | UiCommand::RestoreDeleted
        | UiCommand::CropBox => (Menu::Selection, 2),
        UiCommand::FrameScene
        | UiCommand::Home
        | UiCommand::PreviousCamera
        | UiCommand::NextCamera
        | UiCommand::AutoCamera => (Menu::View, 0),
        UiCommand::ToggleRenderer
        | UiCommand::ComparePhoto
        | UiCommand::CompareModel
        | UiCommand::RemoveModel => (Menu::View, 1),
        UiCommand::Measure => (Menu::View, 2),
        UiCommand::Cameras
        | UiCommand::Points
        | UiCommand::Grid
        | UiCommand::FrameStrip
        | UiCommand::ResetLayout => (Menu::View, 3),
        UiCommand::Train
        | UiCommand::Pause
        | UiCommand::Step
        | UiCommand::Follow
        | UiCommand::Reset => (Menu::Run, 0),
        UiCommand::CopyCommandLine => (Menu::Run, 1),
        UiCommand::Find | UiCommand::FocusControls | UiCommand::Help => (Menu::Help, 0),
    }
}

pub struct MenuContext<'a> {
    /// Recently opened paths, newest first.
    pub recent: &'a [PathBuf],
    /// Reason why an action is unavailable, if any.
    pub why_not: &'a dyn Fn(Action) -> Option<&'static str>,
    /// True if a toggle command is on.
    pub is_on: &'a dyn Fn(UiCommand) -> bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MenuAnswer {
    Action(Action),
    /// Reopen a recent path.
    Open(PathBuf),
}

pub fn ui(context: &MenuContext<'_>, ui: &mut Ui) -> Option<MenuAnswer> {
    let mut asked = None;
    for menu in Menu::ALL {
        ui.menu_button(menu.label(), |ui| {
            let mut commands =
                UiCommand::ALL.map(|command| (menu_and_group(command), command)).to_vec();
            commands.retain(|((of, _), _)| *of == menu);
            // A stable sort keeps the order of the shortcut list within a group.
            commands.sort_by_key(|((_, group), _)| *group);
            let mut before = 0;
            for ((_, group), command) in commands {
                if group != before {
                    ui.separator();
                    before = group;
                }
                asked = item(context, Action::Command(command), ui).or(asked.take());
                if command == UiCommand::OpenDemo {
                    asked = recent(context, ui).or(asked.take());
                }
            }
            if menu == Menu::View {
                ui.separator();
                asked = submenus(context, ui).or(asked.take());
            }
        });
    }
    asked
}

/// Submenus of actions that are not commands.
fn submenus(context: &MenuContext<'_>, ui: &mut Ui) -> Option<MenuAnswer> {
    let mut asked = None;
    type Kind = (&'static str, fn(&Action) -> bool);
    let kinds: [Kind; 3] = [
        ("Panels", |action| matches!(action, Action::Tab(_))),
        ("Compare", |action| matches!(action, Action::Mode(_))),
        ("Colours", |action| matches!(action, Action::Color(_))),
    ];
    for (label, is_of) in kinds {
        ui.menu_button(label, |ui| {
            for action in Action::all().filter(is_of) {
                asked = item(context, action, ui).or(asked.take());
            }
        });
    }
    asked
}

fn item(context: &MenuContext<'_>, action: Action, ui: &mut Ui) -> Option<MenuAnswer> {
    let why_not = (context.why_not)(action);
    let is_on = matches!(action, Action::Command(command) if (context.is_on)(command));
    let button = Button::selectable(is_on, action.menu_label());
    let keys = action.shortcut_text(ui.ctx());
    // Screen readers would announce an empty shortcut as part of the name.
    let button = if keys.is_empty() { button } else { button.shortcut_text(keys) };
    let response = ui.add_enabled(why_not.is_none(), button);
    let response = response.on_hover_text(action.tooltip());
    let is_chosen = response.on_disabled_hover_text(why_not.unwrap_or_default()).clicked();
    if is_chosen {
        ui.close();
    }
    is_chosen.then_some(MenuAnswer::Action(action))
}

fn recent(context: &MenuContext<'_>, ui: &mut Ui) -> Option<MenuAnswer> {
    let mut asked = None;
    let why_not = match context.recent {
        [] => Some("Nothing was opened yet"),
        _ => (context.why_not)(Action::Command(UiCommand::Open)),
    };
    ui.add_enabled_ui(why_not.is_none(), |ui| {
        let menu = ui.menu_button("Recent", |ui| {
            for path in context.recent {
                if ui.button(path.display().to_string()).clicked() {
                    asked = Some(MenuAnswer::Open(path.clone()));
                    ui.close();
                }
            }
        });
        menu.response
            .on_hover_text("Reopen a recent file or folder")
            .on_disabled_hover_text(why_not.unwrap_or_default());
    });
    asked
}
