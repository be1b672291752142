//! Menus of the top bar: every command with its shortcut, and the reason if it is unavailable.

use super::controls::{entry_with_keys, named};
use crate::app::action_finder::Action;
use crate::app::command::{Menu, UiCommand};
use crate::app::fonts::icon;
use eframe::egui::Ui;
use std::path::PathBuf;

/// Menus at the left of the bar, with the icons of the most used ones.
const MENUS: [(Menu, Option<&str>, &str); 4] = [
    (Menu::Open, Some(icon::OPEN), "Open"),
    (Menu::Export, Some(icon::EXPORT), "Export"),
    (Menu::View, None, "View"),
    (Menu::Help, None, "Help"),
];

pub struct MenuContext<'a> {
    pub recent: &'a [PathBuf],
    pub why_not: &'a dyn Fn(Action) -> Option<&'static str>,
    pub is_on: &'a dyn Fn(UiCommand) -> bool,
}

/// Action that the user requests in the top bar.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum BarAnswer {
    Action(Action),
    /// Opens a recently opened path again.
    Open(PathBuf),
    /// Trains again on the same frames, with the chosen level of detail.
    Retrain,
}

pub fn ui(context: &MenuContext<'_>, ui: &mut Ui) -> Option<BarAnswer> {
    let mut asked = None;
    for (menu, icon, label) in MENUS {
        let contents = |ui: &mut Ui| entries(menu, context, ui);
        let shown = match icon {
            Some(icon) => ui.menu_button((icon, label), contents),
            None => ui.menu_button(label, contents),
        };
        named(shown.response, label);
        asked = shown.inner.flatten().or(asked.take());
    }
    asked
}

/// Draws the button that opens the menu beside the training button.
pub fn training(context: &MenuContext<'_>, ui: &mut Ui) -> Option<BarAnswer> {
    let shown = ui.menu_button(icon::MORE, |ui| entries(Menu::Train, context, ui));
    named(shown.response, "Training menu").on_hover_text("One frame, start over, command line");
    shown.inner.flatten()
}

fn entries(menu: Menu, context: &MenuContext<'_>, ui: &mut Ui) -> Option<BarAnswer> {
    let mut asked = None;
    let mut commands = UiCommand::ALL.to_vec();
    commands.retain(|command| command.menu().0 == menu);
    // A stable sort keeps the order of the shortcut list within a group.
    commands.sort_by_key(|command| command.menu().1);
    let mut before = commands.first().map_or(0, |command| command.menu().1);
    for command in commands {
        let group = command.menu().1;
        if std::mem::replace(&mut before, group) != group {
            ui.separator();
        }
        asked = item(context, Action::Command(command), ui).or(asked.take());
        if command == UiCommand::OpenDemo {
            asked = recent(context, ui).or(asked.take());
        }
    }
    if menu == Menu::View {
        ui.separator();
        let selection = ui.menu_button("Selection", |ui| entries(Menu::Selection, context, ui));
        asked = selection.inner.flatten().or(asked.take());
        asked = submenus(context, ui).or(asked.take());
    }
    asked
}

fn submenus(context: &MenuContext<'_>, ui: &mut Ui) -> Option<BarAnswer> {
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

fn item(context: &MenuContext<'_>, action: Action, ui: &mut Ui) -> Option<BarAnswer> {
    let why_not = (context.why_not)(action);
    let is_on = matches!(action, Action::Command(command) if (context.is_on)(command));
    let keys = action.shortcut_text(ui.ctx());
    let texts = [action.menu_label(), &keys, action.tooltip()];
    entry_with_keys(is_on, texts, why_not, ui).then_some(BarAnswer::Action(action))
}

fn recent(context: &MenuContext<'_>, ui: &mut Ui) -> Option<BarAnswer> {
    let mut asked = None;
    let why_not = match context.recent {
        [] => Some("Nothing was opened yet"),
        _ => (context.why_not)(Action::Command(UiCommand::Open)),
    };
    ui.add_enabled_ui(why_not.is_none(), |ui| {
        let menu = ui.menu_button("Recent", |ui| {
            for path in context.recent {
                if ui.button(path.display().to_string()).clicked() {
                    asked = Some(BarAnswer::Open(path.clone()));
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
