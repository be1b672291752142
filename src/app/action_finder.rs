//! The list of everything that can be done, found by some letters of its name.

use super::color_mode::ColorMode;
use super::command::UiCommand;
use super::fuzzy::score;
use super::panels::explained::named;
use super::tab::SideTab;
use super::viewer::mode::ViewMode;
use eframe::egui::{
    Align, Button, Context, Id, Key, Modal, Modifiers, RichText, ScrollArea, TextEdit, Ui, Vec2,
};

/// Size of the list, points.
const LIST: Vec2 = Vec2::new(440.0, 300.0);

/// Something that can be done from anywhere.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    /// A command.
    Command(UiCommand),
    /// Turn the side panel to a tab.
    Tab(SideTab),
    /// Compare so.
    Mode(ViewMode),
    /// Let colours mean this.
    Color(ColorMode),
}

impl Action {
    /// Every action, in the order in which they are listed as long as nothing is typed.
    pub fn all() -> impl Iterator<Item = Self> {
        // Those that are about the keyboard itself are only ever asked for by their keys.
        let is_listed = |c: &UiCommand| !matches!(c, UiCommand::Find | UiCommand::FocusControls);
        let commands = UiCommand::ALL.into_iter().filter(is_listed);
        let rest = SideTab::ALL.into_iter().map(Self::Tab);
        let rest = rest.chain(ViewMode::ALL.into_iter().map(Self::Mode));
        commands.map(Self::Command).chain(rest).chain(ColorMode::ALL.into_iter().map(Self::Color))
    }

    /// Its name.
    pub fn name(self) -> String {
        match self {
            Self::Command(command) => command.name().to_owned(),
            Self::Tab(tab) => format!("Tab: {}", tab.label()),
            Self::Mode(mode) => format!("View: {}", mode.label()),
            Self::Color(mode) => format!("Colours: {}", mode.label()),
        }
    }

    /// As a menu of its own kind names it.
    pub fn menu_label(self) -> &'static str {
        match self {
            Self::Command(command @ (UiCommand::PreviousCamera | UiCommand::NextCamera)) => {
                command.name()
            }
            Self::Command(command) => command.label(),
            Self::Tab(tab) => tab.label(),
            Self::Mode(mode) => mode.label(),
            Self::Color(mode) => mode.label(),
        }
    }

    /// One sentence on what it does.
    pub fn tooltip(self) -> &'static str {
        match self {
            Self::Command(command) => command.tooltip(),
            Self::Tab(_) => "Turn to this panel",
            Self::Mode(mode) => mode.tooltip(),
            Self::Color(mode) => mode.tooltip(),
        }
    }

    /// Its keys as menus show them, empty if it has none.
    pub fn keys(self, ctx: &Context) -> String {
        match self {
            Self::Command(command) => command.keys(ctx),
            Self::Tab(_) | Self::Mode(_) | Self::Color(_) => String::new(),
        }
    }
}

/// The list over the window, open or not.
#[derive(Default)]
pub struct ActionFinder {
    is_open: bool,
    typed: String,
    /// Which of those found the keyboard chooses.
    chosen: usize,
}

impl ActionFinder {
    /// Opens it with nothing typed.
    pub fn show(&mut self) {
        *self = Self { is_open: true, ..Self::default() };
    }

    /// Whether it takes the keys.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Draws the list; what was chosen. Actions that are not possible now are listed last.
    pub fn ui(&mut self, ui: &Ui, is_possible: impl Fn(Action) -> bool) -> Option<Action> {
        if !self.is_open {
            return None;
        }
        let mut asked = None;
        let modal = Modal::new(Id::unique("actions")).show(ui.ctx(), |ui| {
            ui.set_width(LIST.x);
            let (moved, is_entered) = keys(ui);
            self.search(ui);
            let found = found(&self.typed, is_possible);
            let n = found.iter().filter(|(_, is_possible)| *is_possible).count();
            self.chosen = self.chosen.saturating_add_signed(moved).min(n.saturating_sub(1));
            if is_entered && n > 0 {
                asked = Some(found[self.chosen].0);
            }
            asked = self.list(&found, moved != 0, ui).or(asked);
        });
        self.is_open = asked.is_none() && !modal.should_close();
        asked
    }

    fn search(&mut self, ui: &mut Ui) {
        let field = TextEdit::singleline(&mut self.typed).hint_text("Find an action");
        let field = named(ui.add(field.desired_width(f32::INFINITY)), "Find an action");
        field.request_focus();
        if field.changed() {
            self.chosen = 0;
        }
    }

    fn list(&self, found: &[(Action, bool)], has_moved: bool, ui: &mut Ui) -> Option<Action> {
        let mut asked = None;
        if found.is_empty() {
            ui.label(RichText::new("No action is named so").weak());
        }
        ScrollArea::vertical().auto_shrink(false).max_height(LIST.y).show(ui, |ui| {
            for (i, &(action, is_possible)) in found.iter().enumerate() {
                let is_chosen = is_possible && i == self.chosen;
                let keys = action.keys(ui.ctx());
                let button = Button::selectable(is_chosen, action.name()).shortcut_text(keys);
                let row = ui.add_enabled(is_possible, button.min_size(Vec2::new(LIST.x, 0.0)));
                let row = row.on_hover_text(action.tooltip());
                if is_chosen && has_moved {
                    row.scroll_to_me(Some(Align::Center));
                }
                if row.clicked() {
                    asked = Some(action);
                }
            }
        });
        asked
    }
}

/// How far the keyboard moves the choice, and whether it takes it. Before the text field, which would
/// take these keys.
fn keys(ui: &Ui) -> (isize, bool) {
    ui.input_mut(|i| {
        let down = i.consume_key(Modifiers::NONE, Key::ArrowDown);
        let up = i.consume_key(Modifiers::NONE, Key::ArrowUp);
        let moved = isize::from(down) - isize::from(up);
        (moved, i.consume_key(Modifiers::NONE, Key::Enter))
    })
}

/// The actions that go with what was typed, the best first, and those that are possible before others.
fn found(typed: &str, is_possible: impl Fn(Action) -> bool) -> Vec<(Action, bool)> {
    let mut found: Vec<_> = Action::all()
        .filter_map(|action| Some((score(&action.name(), typed)?, action, is_possible(action))))
        .collect();
    // Stable: what goes equally well stays in its order.
    found.sort_by_key(|&(score, _, is_possible)| (!is_possible, std::cmp::Reverse(score)));
    found.into_iter().map(|(_, action, is_possible)| (action, is_possible)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn possible_actions_come_first_and_no_two_have_one_name() {
        let is_possible = |action| action != Action::Command(UiCommand::Export);
        let listed = found("exp", is_possible);
        assert_eq!(listed.last(), Some(&(Action::Command(UiCommand::Export), false)));
        assert_eq!(found("exp", |_| true)[0], (Action::Command(UiCommand::Export), true));
        let mut names: Vec<_> = Action::all().map(Action::name).collect();
        let n = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), n);
    }
}
