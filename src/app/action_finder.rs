//! Searchable list of all actions, filtered by fuzzy matching of their names.

use super::color_mode::ColorMode;
use super::command::UiCommand;
use super::layout::SideTab;
use super::panels::controls::named;
use super::viewer::toolbar::ViewMode;
use eframe::egui::{
    Align, Button, Context, Id, Key, Modal, Modifiers, RichText, ScrollArea, TextEdit, Ui, Vec2,
};

const LIST: Vec2 = Vec2::new(440.0, 300.0);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Action {
    Command(UiCommand),
    Tab(SideTab),
    Mode(ViewMode),
    Color(ColorMode),
}

impl Action {
    /// Returns every action of the list, in the order shown while the search text is empty.
    pub fn all() -> impl Iterator<Item = Self> {
        // Commands about the keyboard itself are useful only as shortcuts.
        let is_listed = |c: &UiCommand| !matches!(c, UiCommand::Find | UiCommand::FocusControls);
        let commands = UiCommand::ALL.into_iter().filter(is_listed);
        let rest = SideTab::ALL.into_iter().map(Self::Tab);
        let rest = rest.chain(ViewMode::ALL.into_iter().map(Self::Mode));
        commands.map(Self::Command).chain(rest).chain(ColorMode::ALL.into_iter().map(Self::Color))
    }

    pub fn name(self) -> String {
        match self {
            Self::Command(command) => command.full_name().to_owned(),
            Self::Tab(tab) => format!("Tab: {}", tab.label()),
            Self::Mode(mode) => format!("View: {}", mode.label()),
            Self::Color(mode) => format!("Colours: {}", mode.label()),
        }
    }

    /// Returns the action's label in menus, without the prefix that [`Self::name`] adds for some kinds of
    /// actions.
    pub fn menu_label(self) -> &'static str {
        match self {
            Self::Command(command @ (UiCommand::PreviousCamera | UiCommand::NextCamera)) => {
                command.full_name()
            }
            Self::Command(command) => command.label(),
            Self::Tab(tab) => tab.label(),
            Self::Mode(mode) => mode.label(),
            Self::Color(mode) => mode.label(),
        }
    }

    pub fn tooltip(self) -> &'static str {
        match self {
            Self::Command(command) => command.tooltip(),
            Self::Tab(tab) => tab.tooltip(),
            Self::Mode(mode) => mode.tooltip(),
            Self::Color(mode) => mode.tooltip(),
        }
    }

    /// Returns other words by which the action is found.
    fn synonyms(self) -> &'static [&'static str] {
        match self {
            Self::Command(UiCommand::Export) => &["mesh", "point cloud", "ply", "glb", "spz"],
            Self::Command(UiCommand::SavePicture) => &["screenshot", "png", "image"],
            Self::Command(UiCommand::Train) => &["start", "run", "play"],
            Self::Command(UiCommand::Pause) => &["stop"],
            Self::Command(UiCommand::Reset) => &["restart"],
            Self::Command(UiCommand::RetrainFiner) => &["again", "sharper", "detail"],
            Self::Command(UiCommand::Help) => &["keys", "keyboard"],
            Self::Command(UiCommand::About) => &["version", "licence"],
            Self::Command(UiCommand::Follow) => &["camera stream", "recording"],
            Self::Tab(SideTab::Path) => &["film", "video", "turntable"],
            Self::Tab(SideTab::Edit) => &["crop", "walk back", "undo"],
            _ => &[],
        }
    }

    /// Returns the action's shortcuts as shown in menus; empty if there are none.
    pub fn shortcut_text(self, ctx: &Context) -> String {
        match self {
            Self::Command(command) => command.keys(ctx),
            Self::Tab(_) | Self::Mode(_) | Self::Color(_) => String::new(),
        }
    }
}

#[derive(Default)]
pub struct ActionFinder {
    is_open: bool,
    query: String,
    /// Index of the entry chosen with the arrow keys, among the available actions in the list.
    chosen_index: usize,
}

impl ActionFinder {
    pub fn show(&mut self) {
        *self = Self { is_open: true, ..Self::default() };
    }

    /// True while the finder consumes keyboard input.
    pub fn is_open(&self) -> bool {
        self.is_open
    }

    /// Draws the list and returns the chosen action. Unavailable actions come last.
    pub fn ui(&mut self, ui: &Ui, is_possible: impl Fn(Action) -> bool) -> Option<Action> {
        if !self.is_open {
            return None;
        }
        let mut asked = None;
        let modal = Modal::new(Id::unique("actions")).show(ui.ctx(), |ui| {
            ui.set_width(LIST.x);
            let (moved, is_entered) = consume_keys(ui);
            self.search(ui);
            let found = matching_actions(&self.query, is_possible);
            let n = found.iter().filter(|(_, is_possible)| *is_possible).count();
            self.chosen_index =
                self.chosen_index.saturating_add_signed(moved).min(n.saturating_sub(1));
            if is_entered && n > 0 {
                asked = Some(found[self.chosen_index].0);
            }
            asked = self.list(&found, moved != 0, ui).or(asked);
        });
        self.is_open = asked.is_none() && !modal.should_close();
        asked
    }

    fn search(&mut self, ui: &mut Ui) {
        let field = TextEdit::singleline(&mut self.query).hint_text("Find an action");
        let field = named(ui.add(field.desired_width(f32::INFINITY)), "Find an action");
        // The finder exists only to type and choose.
        if !field.has_focus() {
            field.request_focus();
            tracing::debug!("shown: the list of actions");
        }
        if field.changed() {
            self.chosen_index = 0;
        }
    }

    fn list(&self, found: &[(Action, bool)], has_moved: bool, ui: &mut Ui) -> Option<Action> {
        let mut asked = None;
        if found.is_empty() {
            ui.label(RichText::new("Nothing found").weak());
        }
        ScrollArea::vertical().auto_shrink(false).max_height(LIST.y).show(ui, |ui| {
            for (i, &(action, is_possible)) in found.iter().enumerate() {
                let is_chosen = is_possible && i == self.chosen_index;
                let keys = action.shortcut_text(ui.ctx());
                let button = Button::selectable(is_chosen, action.name()).shortcut_text(keys);
                let row = ui.add_enabled(is_possible, button.min_size(Vec2::new(LIST.x, 0.0)));
                let row = row.on_hover_text(action.tooltip());
                // Only then, or the wheel could not scroll away from the chosen row.
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

/// Consumes the arrow and Enter keys. Returns the number of entries to move down (negative: up), and
/// true if Enter was pressed.
fn consume_keys(ui: &Ui) -> (isize, bool) {
    // Handled before the text field, which would consume these keys itself.
    ui.input_mut(|i| {
        let down = i.consume_key(Modifiers::NONE, Key::ArrowDown);
        let up = i.consume_key(Modifiers::NONE, Key::ArrowUp);
        let moved = isize::from(down) - isize::from(up);
        (moved, i.consume_key(Modifiers::NONE, Key::Enter))
    })
}

/// Returns the matching actions and whether each is available. Available actions come first; within each
/// group the order is by descending score.
fn matching_actions(typed: &str, is_possible: impl Fn(Action) -> bool) -> Vec<(Action, bool)> {
    let best = |action: Action| {
        let by_synonym = action.synonyms().iter().filter_map(|name| score(name, typed)).max();
        score(&action.name(), typed).max(by_synonym)
    };
    let mut found: Vec<_> = Action::all()
        .filter_map(|action| Some((best(action)?, action, is_possible(action))))
        .collect();
    // A stable sort keeps the listed order among equal scores.
    found.sort_by_key(|&(score, _, is_possible)| (!is_possible, std::cmp::Reverse(score)));
    found.into_iter().map(|(_, action, is_possible)| (action, is_possible)).collect()
}

/// Returns a score of how well a name matches a search text. `None` unless the name contains the letters
/// of the text in order. Letters that begin a word or follow each other score higher. Spaces and case
/// are ignored.
pub fn score(name: &str, typed: &str) -> Option<u32> {
    let letters = typed.chars().filter(|c| !c.is_whitespace());
    let mut wanted = letters.flat_map(char::to_lowercase).peekable();
    let (mut score, mut run, mut before) = (0, 0, ' ');
    for letter in name.chars().flat_map(char::to_lowercase) {
        if wanted.next_if_eq(&letter).is_some() {
            run += 1;
            score += run + if before.is_alphanumeric() { 0 } else { 3 };
        } else {
            run = 0;
        }
        before = letter;
    }
    wanted.peek().is_none().then_some(score)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn possible_actions_come_first_and_no_two_have_one_name() {
        let is_possible = |action| action != Action::Command(UiCommand::Export);
        let listed = matching_actions("exp", is_possible);
        assert_eq!(listed.last(), Some(&(Action::Command(UiCommand::Export), false)));
        assert_eq!(
            matching_actions("exp", |_| true)[0],
            (Action::Command(UiCommand::Export), true)
        );
        let mut names: Vec<_> = Action::all().map(Action::name).collect();
        let n = names.len();
        names.sort();
        names.dedup();
        assert_eq!(names.len(), n);
        let first = |typed| matching_actions(typed, |_| true)[0].0;
        assert_eq!(first("screenshot"), Action::Command(UiCommand::SavePicture));
        assert_eq!(first("mesh"), Action::Command(UiCommand::Export));
    }

    #[test]
    fn letters_in_order_are_found_and_beginnings_of_words_come_first() {
        assert_eq!(score("Frame scene", "xf"), None);
        assert_eq!(score("Frame scene", "scenes"), None);
        assert_eq!(score("Frame scene", ""), Some(0));
        assert!(score("Frame scene", "FS") > score("Quality of us", "fs"));
        assert!(score("Export", "exp") > score("Next photograph", "exp"));
        assert!(score("Wipe photograph", "wipe photo").is_some());
    }
}
