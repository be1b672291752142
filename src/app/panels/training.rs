//! Training settings for the next opened or reset run.

use super::controls;
use super::controls::{choices, optional_number};
use super::signal_color::SignalColor;
use crate::app::training::TrainSettings;
use crate::pipeline::autosave;
use crate::train::paper::config::{PaperConfig, PaperOverrides};
use crate::train::setting::Preset;
use crate::train::setting::table::{Setting, SettingLayer};
use eframe::egui::{CollapsingHeader, ComboBox, Grid, Label, Response, RichText, TextEdit, Ui};
use std::ops::RangeInclusive;

const AUTOSAVES_S: RangeInclusive<u32> = 1..=3600;

pub fn ui(settings: &mut TrainSettings, ui: &mut Ui) {
    const PAPER_HELP: &str =
        "The published algorithm; 100,000 components unless changed in Details";
    let presets = [
        (Preset::Scene, "Scene preset", "Creates components on observed surfaces"),
        (Preset::Paper, "Paper preset", PAPER_HELP),
    ];
    ui.horizontal(|ui| choices(&mut settings.preset, &presets, ui));
    if settings.preset == Preset::Scene {
        // The types of these settings check their ranges.
        details(&mut settings.scene, |_| Ok(()), ui);
    } else {
        let check = |paper: &PaperOverrides| {
            PaperConfig::paper().with(paper).map(drop).map_err(|refused| refused.to_string())
        };
        details(&mut settings.paper, check, ui);
    }
    ui.label(RichText::new("Applies to runs that begin from now on, and after Reset").weak());
    let help = "Saves during training; after a crash, the next start offers to resume";
    let texts = ["Autosave every", help, "Autosave every", " s"];
    optional_number(&mut settings.autosave_s, autosave::DEFAULT_S, AUTOSAVES_S, texts, ui);
}

/// Draws the settings of a preset. `check` validates them and returns a message for the user if they are
/// invalid.
fn details<L: SettingLayer + Clone>(
    layer: &mut L,
    check: impl Fn(&L) -> Result<(), String>,
    ui: &mut Ui,
) {
    let n = listed::<L>().filter(|setting| differs(setting, layer)).count();
    let title = if n == 0 { "Details".to_owned() } else { format!("Details: {n} changed") };
    let details = CollapsingHeader::new(title).id_salt("details");
    details.show(ui, |ui| rows(layer, check, ui));
}

/// Maximum number of choices shown as buttons; longer lists are shown as a menu.
const MAX_BUTTONS: usize = 3;
const FIELD: f32 = 80.0;

#[derive(Clone)]
struct Typed {
    text: String,
    /// Value before editing; `None` if it was the default.
    before: Option<String>,
}

fn listed<L: SettingLayer>() -> impl Iterator<Item = &'static Setting<L>> {
    L::TABLE.iter().filter(|setting| setting.about.label.is_some())
}

fn differs<L: SettingLayer>(setting: &Setting<L>, layer: &L) -> bool {
    (setting.given)(layer).is_some_and(|value| value != setting.about.default)
}

/// Draws the settings that have a value, then those that are switched on or off.
fn rows<L: SettingLayer + Clone>(
    layer: &mut L,
    check: impl Fn(&L) -> Result<(), String>,
    ui: &mut Ui,
) {
    // A setting is a switch or not, whatever the layer contains.
    let is_part = |setting: &&Setting<L>| (setting.flag)(&mut L::default()).is_some();
    let mut problem = None;
    // The id depends on the preset: grids of the same id would share their column widths.
    Grid::new(L::EXAMPLE).num_columns(3).min_col_width(0.0).show(ui, |ui| {
        for setting in listed::<L>().filter(|setting| !is_part(setting)) {
            reset_marker(setting, layer, ui);
            let name = ui.label(setting.about.label.unwrap_or_default());
            let name = name.on_hover_text(setting.about.help());
            if (setting.about.choices)().is_empty() {
                problem = typed(setting, layer, &check, &name, ui).or(problem.take());
            } else {
                choice(setting, layer, &name, ui);
            }
            ui.end_row();
        }
    });
    // Below the grid, where a long message wraps; inside, it would widen the panel.
    if let Some(problem) = problem {
        ui.add(Label::new(SignalColor::Red.text(problem, ui)).wrap());
    }
    if listed::<L>().any(|setting| is_part(&setting)) {
        ui.label("Preparation of frames")
            .on_hover_text("The view mode “Preparation” shows the result for every pixel");
    }
    listed::<L>().filter(is_part).for_each(|setting| part(setting, layer, ui));
}

fn reset_marker<L: SettingLayer>(setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
    let about = &setting.about;
    let is_back = controls::reset_dot(
        about.label.unwrap_or_default(),
        about.default,
        differs(setting, layer),
        ui,
    );
    if is_back {
        (setting.clear)(layer);
    }
}

/// Draws a text field for a setting, in the syntax of the command line. Returns an error message if the
/// text is invalid.
fn typed<L: SettingLayer + Clone>(
    setting: &Setting<L>,
    layer: &mut L,
    check: impl Fn(&L) -> Result<(), String>,
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
    let mut changed = layer.clone();
    let parsed = (setting.parse)(&mut changed, typed.text.trim().as_ref())
        .map_err(|error| error.to_string())
        .and_then(|()| check(&changed))
        .map(|()| changed);
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

fn part<L: SettingLayer>(setting: &Setting<L>, layer: &mut L, ui: &mut Ui) {
    let Some(&mut part) = (setting.flag)(layer) else { return };
    let mut is_on = part.unwrap_or(true);
    ui.horizontal(|ui| {
        let checkbox = ui.checkbox(&mut is_on, setting.about.label.unwrap_or_default());
        let is_changed = checkbox.on_hover_text(setting.about.help()).changed();
        if is_changed && let Some(part) = (setting.flag)(layer) {
            // `true` is the default, which a layer leaves out.
            *part = (!is_on).then_some(false);
        }
        reset_marker(setting, layer, ui);
    });
}

/// Draws the buttons or the menu of a setting with named values. A choice of the default clears the
/// setting.
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
