//! Rows of a preset's settings, generated from the labelled entries of its settings table.
//!
//! The entry determines the control: few named values are buttons, more are a menu, switches are check
//! boxes. Everything else is a text field with the syntax of the command line, since values such as
//! `dense` or `2.5px` fit no slider.

use super::badge;
use super::signal_color::SignalColor;
use crate::train::setting::table::{Setting, SettingLayer, Spelling};
use eframe::egui::{ComboBox, Grid, Label, Response, RichText, TextEdit, Ui};

/// Maximum number of values shown as buttons.
const MAX_BUTTONS: usize = 3;
const FIELD: f32 = 80.0;

/// Setting with a custom control instead of that of its table entry.
pub struct CustomRow<L> {
    /// Field name in the table.
    pub field: &'static str,
    /// Default value as shown by the reset marker.
    pub default: &'static str,
    pub draw: fn(&mut L, &mut Ui),
}

/// Preset-specific parts of the rows.
pub struct SettingRows<L: 'static> {
    pub custom: &'static [CustomRow<L>],
    /// Validates the settings; the error is a message for the user.
    pub check: fn(&L) -> Result<(), String>,
}

/// Text field being edited.
#[derive(Clone)]
struct Typed {
    text: String,
    /// Value before editing; `None` if the default applied.
    before: Option<String>,
}

/// Number of settings that differ from their default.
pub fn n_changed<L: SettingLayer>(layer: &L) -> usize {
    listed::<L>().filter(|setting| differs(setting, layer)).count()
}

/// Settings with a label in the table.
fn listed<L: SettingLayer>() -> impl Iterator<Item = &'static Setting<L>> {
    L::TABLE.iter().filter(|setting| setting.about.label.is_some())
}

/// True if a setting is given and differs from its default.
fn differs<L: SettingLayer>(setting: &Setting<L>, layer: &L) -> bool {
    (setting.given)(layer).is_some_and(|value| value != setting.about.default)
}

impl<L: SettingLayer + Clone> SettingRows<L> {
    /// Draws the settings with values, then the switches.
    pub fn ui(&self, layer: &mut L, ui: &mut Ui) {
        let is_part = |setting: &&Setting<L>| matches!(setting.about.spelling, Spelling::Part(_));
        let mut problem = None;
        // The id depends on the preset: grids of the same id would share their column widths.
        Grid::new(L::EXAMPLE).num_columns(3).min_col_width(0.0).show(ui, |ui| {
            for setting in listed::<L>().filter(|setting| !is_part(setting)) {
                self.reset_marker(setting, layer, ui);
                let name = ui.label(setting.about.label.unwrap_or_default());
                let name = name.on_hover_text(setting.about.help());
                match self.custom_row(setting) {
                    Some(own) => (own.draw)(layer, ui),
                    None if (setting.about.choices)().is_empty() => {
                        problem = self.typed(setting, layer, &name, ui).or(problem.take());
                    }
                    None => choice(setting, layer, &name, ui),
                }
                ui.end_row();
            }
        });
        // Below the grid, where a long message wraps; inside, it would widen the panel.
        if let Some(problem) = problem {
            let color = SignalColor::Red.for_theme(ui.visuals().dark_mode);
            ui.add(Label::new(RichText::new(problem).color(color)).wrap());
        }
        if listed::<L>().any(|setting| is_part(&setting)) {
            ui.label("Preparation of frames")
                .on_hover_text("The view mode “Preparation” shows the result for every pixel");
        }
        listed::<L>().filter(is_part).for_each(|setting| self.part(setting, layer, ui));
    }

    fn custom_row(&self, setting: &Setting<L>) -> Option<&CustomRow<L>> {
        self.custom.iter().find(|own| own.field == setting.about.field)
    }

    /// Draws the marker of a changed setting; a click resets it.
    fn reset_marker(&self, setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
        let about = &setting.about;
        let default = self.custom_row(setting).map_or(about.default, |own| own.default);
        let is_back =
            badge::ui(about.label.unwrap_or_default(), default, differs(setting, layer), ui);
        if is_back {
            (setting.clear)(layer);
        }
    }

    /// Draws a text field with the syntax of the command line; returns the message if the text is invalid.
    fn typed(
        &self,
        setting: &Setting<L>,
        layer: &mut L,
        name: &Response,
        ui: &mut Ui,
    ) -> Option<String> {
        let about = &setting.about;
        let id = ui.make_persistent_id((about.field, "as typed"));
        let given = (setting.given)(layer);
        // The text is retained while the field has focus, since an incomplete number must not be overwritten.
        let typed: Option<Typed> = ui.data(|data| data.get_temp(id));
        let mut typed = typed.unwrap_or_else(|| Typed {
            text: given.clone().unwrap_or_else(|| about.default.to_owned()),
            before: given,
        });
        let range = about.range.map_or_else(String::new, |range| format!(": {}", range()));
        let field = ui
            .add(TextEdit::singleline(&mut typed.text).desired_width(FIELD))
            .labelled_by(name.id)
            .on_hover_text(format!("{}{range}", about.help()));
        let parsed = self.with_parsed(setting, layer, &typed.text);
        if field.changed() {
            match (&parsed, &typed.before) {
                (Ok(parsed), _) => layer.clone_from(parsed),
                // Restores the previous value, not the one parsed from the first digits of an invalid number.
                (Err(_), Some(before)) => drop((setting.parse)(layer, before.as_ref())),
                (Err(_), None) => (setting.clear)(layer),
            }
            ui.data_mut(|data| data.insert_temp(id, typed));
        }
        if !field.has_focus() {
            ui.data_mut(|data| data.remove::<Typed>(id));
            return None;
        }
        parsed.err()
    }

    /// Settings with one of them parsed from a text.
    fn with_parsed(&self, setting: &Setting<L>, layer: &L, text: &str) -> Result<L, String> {
        let mut changed = layer.clone();
        (setting.parse)(&mut changed, text.trim().as_ref()).map_err(|error| error.to_string())?;
        (self.check)(&changed).map(|()| changed)
    }

    /// Draws a switch that is on by default.
    fn part(&self, setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
        let Some(&mut part) = (setting.flag)(layer) else { return };
        let mut is_on = part.unwrap_or(true);
        ui.horizontal(|ui| {
            let checkbox = ui.checkbox(&mut is_on, setting.about.label.unwrap_or_default());
            let is_changed = checkbox.on_hover_text(setting.about.help()).changed();
            if is_changed && let Some(part) = (setting.flag)(layer) {
                *part = (!is_on).then_some(false);
            }
            self.reset_marker(setting, layer, ui);
        });
    }
}

/// Draws the buttons or menu of a setting with named values; choosing the default clears the setting.
fn choice<L: SettingLayer>(setting: &Setting<L>, layer: &mut L, name: &Response, ui: &mut Ui) {
    let about = &setting.about;
    // The text after a semicolon describes defaults in other cases.
    let default = about.default.split(';').next().unwrap_or_default();
    let now = (setting.given)(layer).unwrap_or_else(|| default.to_owned());
    let choices = (about.choices)();
    let mut chosen = None;
    let all = |ui: &mut Ui| {
        for choice in &choices {
            let button = ui.selectable_label(choice.name == now, choice.label);
            let help = if choice.help.is_empty() { about.help() } else { choice.help };
            if button.on_hover_text(help).clicked() {
                chosen = Some(choice.name);
            }
        }
    };
    if choices.len() <= MAX_BUTTONS {
        ui.horizontal(all);
    } else {
        let shown = choices.iter().find(|choice| choice.name == now);
        let shown = shown.map_or(now.as_str(), |choice| choice.label);
        let menu = ComboBox::from_id_salt(about.field).selected_text(shown);
        menu.show_ui(ui, all).response.labelled_by(name.id);
    }
    match chosen {
        Some(name) if name == default => (setting.clear)(layer),
        // Cannot fail: the name is one of the setting's own choices.
        Some(name) => drop((setting.parse)(layer, name.as_ref())),
        None => {}
    }
}
