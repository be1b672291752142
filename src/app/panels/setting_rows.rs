//! A preset's settings, row by row, as far as its table gives them labels.
//!
//! What a row looks like follows from its table entry alone: few named values are buttons, more a menu,
//! what is on or off a checkbox, and everything else is typed as on the command line, since a number or
//! a word (`dense`, `2.5px`) fits in no slider.

use super::badge;
use super::signal_color::SignalColor;
use crate::train::setting::table::{Setting, SettingLayer, Spelling};
use eframe::egui::{ComboBox, Grid, Label, Response, RichText, TextEdit, Ui};

/// Most named values that stand beside each other.
const MAX_BUTTONS: usize = 3;
/// Width of a text field, points.
const FIELD: f32 = 80.0;

/// A setting that is drawn otherwise than its table entry says.
pub struct OwnRow<L> {
    /// Its name in the table.
    pub field: &'static str,
    /// What it is by default, as its mark says it.
    pub default: &'static str,
    /// Draws its value.
    pub draw: fn(&mut L, &mut Ui),
}

/// What is special about a preset's rows.
pub struct SettingRows<L: 'static> {
    /// Settings drawn otherwise.
    pub own: &'static [OwnRow<L>],
    /// Says what is wrong with settings, if anything is.
    pub check: fn(&L) -> Result<(), String>,
}

/// A value while it is typed.
#[derive(Clone)]
struct Typed {
    text: String,
    /// The one that was given before, if one was.
    before: Option<String>,
}

/// How many settings are not as they are by default.
pub fn n_changed<L: SettingLayer>(layer: &L) -> usize {
    listed::<L>().filter(|setting| differs(setting, layer)).count()
}

/// The settings that the table gives a label.
fn listed<L: SettingLayer>() -> impl Iterator<Item = &'static Setting<L>> {
    L::TABLE.iter().filter(|setting| setting.about.label.is_some())
}

/// Whether a setting is given, and not as it is by default.
fn differs<L: SettingLayer>(setting: &Setting<L>, layer: &L) -> bool {
    (setting.given)(layer).is_some_and(|value| value != setting.about.default)
}

impl<L: SettingLayer + Clone> SettingRows<L> {
    /// First the settings with values, then what is on or off.
    pub fn ui(&self, layer: &mut L, ui: &mut Ui) {
        let is_part = |setting: &&Setting<L>| matches!(setting.about.spelling, Spelling::Part(_));
        let mut problem = None;
        // By preset: two grids of one name would share the widths of their columns.
        Grid::new(L::EXAMPLE).num_columns(3).min_col_width(0.0).show(ui, |ui| {
            for setting in listed::<L>().filter(|setting| !is_part(setting)) {
                self.mark(setting, layer, ui);
                let name = ui.label(setting.about.label.unwrap_or_default());
                let name = name.on_hover_text(setting.about.help());
                match self.own(setting) {
                    Some(own) => (own.draw)(layer, ui),
                    None if (setting.about.choices)().is_empty() => {
                        problem = self.typed(setting, layer, &name, ui).or(problem.take());
                    }
                    None => choice(setting, layer, &name, ui),
                }
                ui.end_row();
            }
        });
        // Below, where a long sentence wraps: in the grid it would widen the panel.
        if let Some(problem) = problem {
            let color = SignalColor::Red.on(ui.visuals().dark_mode);
            ui.add(Label::new(RichText::new(problem).color(color)).wrap());
        }
        if listed::<L>().any(|setting| is_part(&setting)) {
            ui.label("Preparation of frames")
                .on_hover_text("The view “Preparation” shows what becomes of every pixel");
        }
        listed::<L>().filter(is_part).for_each(|setting| self.part(setting, layer, ui));
    }

    fn own(&self, setting: &Setting<L>) -> Option<&OwnRow<L>> {
        self.own.iter().find(|own| own.field == setting.about.field)
    }

    /// The mark of a setting that differs from its default; a click takes it back.
    fn mark(&self, setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
        let about = &setting.about;
        let default = self.own(setting).map_or(about.default, |own| own.default);
        let is_back =
            badge::ui(about.label.unwrap_or_default(), default, differs(setting, layer), ui);
        if is_back {
            (setting.clear)(layer);
        }
    }

    /// Typed as on the command line. What is wrong with it while it is typed, if anything is.
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
        // Kept while it is typed: half a number is none, and must not be overwritten.
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
        let parsed = self.parsed(setting, layer, &typed.text);
        if field.changed() {
            match (&parsed, &typed.before) {
                (Ok(parsed), _) => layer.clone_from(parsed),
                // As it was, and not as the first digits of a number too large would have it.
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

    /// The settings with one of them as a text says.
    fn parsed(&self, setting: &Setting<L>, layer: &L, text: &str) -> Result<L, String> {
        let mut changed = layer.clone();
        (setting.parse)(&mut changed, text.trim().as_ref()).map_err(|error| error.to_string())?;
        (self.check)(&changed).map(|()| changed)
    }

    /// What is on unless it is left out.
    fn part(&self, setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
        let Some(&mut part) = (setting.flag)(layer) else { return };
        let mut is_on = part.unwrap_or(true);
        ui.horizontal(|ui| {
            let checkbox = ui.checkbox(&mut is_on, setting.about.label.unwrap_or_default());
            let is_changed = checkbox.on_hover_text(setting.about.help()).changed();
            if is_changed && let Some(part) = (setting.flag)(layer) {
                *part = (!is_on).then_some(false);
            }
            self.mark(setting, layer, ui);
        });
    }
}

/// One of a few values; the default is left to the preset.
fn choice<L: SettingLayer>(setting: &Setting<L>, layer: &mut L, name: &Response, ui: &mut Ui) {
    let about = &setting.about;
    // What a default is in other cases follows a semicolon.
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
        // Of the setting's own names, which are all read.
        Some(name) => drop((setting.parse)(layer, name.as_ref())),
        None => {}
    }
}
