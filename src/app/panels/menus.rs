//! The menus: every command by its name, with its keys, and why it cannot be given just now.

use crate::app::action_finder::Action;
use crate::app::command::UiCommand;
use eframe::egui::{Button, Ui};
use std::path::PathBuf;

/// A menu of the bar. The one of training is not called so: that is a button's name.
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

/// The menu of a command and its group there; lines part the groups.
fn place(command: UiCommand) -> (Menu, u8) {
    match command {
        UiCommand::Open | UiCommand::OpenDemo => (Menu::File, 0),
        UiCommand::Save | UiCommand::Export | UiCommand::SavePicture => (Menu::File, 1),
        UiCommand::Quit => (Menu::File, 2),
        UiCommand::Undo | UiCommand::Redo => (Menu::Selection, 0),
        UiCommand::BoxSelect | UiCommand::Deselect => (Menu::Selection, 1),
        UiCommand::HideSelected
        | UiCommand::ShowHidden
        | UiCommand::DeleteSelected
        | UiCommand::BringBack
        | UiCommand::CropBox => (Menu::Selection, 2),
        UiCommand::FrameScene
        | UiCommand::Home
        | UiCommand::PreviousCamera
        | UiCommand::NextCamera
        | UiCommand::RideAlong => (Menu::View, 0),
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

/// What the menus show of the window.
pub struct MenuContext<'a> {
    /// Paths that were open before, the newest first.
    pub recent: &'a [PathBuf],
    /// Why an action is not possible now, if it is not.
    pub why_not: &'a dyn Fn(Action) -> Option<&'static str>,
    /// Whether what a command switches is on.
    pub is_on: &'a dyn Fn(UiCommand) -> bool,
}

/// What the user chose.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum MenuAnswer {
    /// Something to do.
    Action(Action),
    /// Something that was open before.
    Open(PathBuf),
}

/// Draws the buttons that open the menus.
pub fn ui(context: &MenuContext<'_>, ui: &mut Ui) -> Option<MenuAnswer> {
    let mut asked = None;
    for menu in Menu::ALL {
        ui.menu_button(menu.label(), |ui| {
            let mut commands = UiCommand::ALL.map(|command| (place(command), command)).to_vec();
            commands.retain(|((of, _), _)| *of == menu);
            // Stable: within a group they stand in the order of the list of keys.
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

/// What is not a command: tabs, comparisons and meanings of colours.
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
    let keys = action.keys(ui.ctx());
    // A text that is empty would be read out as part of the name.
    let button = if keys.is_empty() { button } else { button.shortcut_text(keys) };
    let response = ui.add_enabled(why_not.is_none(), button);
    let response = response.on_hover_text(action.tooltip());
    let is_chosen = response.on_disabled_hover_text(why_not.unwrap_or_default()).clicked();
    if is_chosen {
        ui.close();
    }
    is_chosen.then_some(MenuAnswer::Action(action))
}

/// The menu of what was open before.
fn recent(context: &MenuContext<'_>, ui: &mut Ui) -> Option<MenuAnswer> {
    let mut asked = None;
    let why_not = match context.recent {
        [] => Some("Nothing was opened so far"),
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
            .on_hover_text("Open again what was open before")
            .on_disabled_hover_text(why_not.unwrap_or_default());
    });
    asked
}
