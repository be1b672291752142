//! How what is opened or reset next is trained.

use super::badge;
use super::signal_color::SignalColor;
use crate::app::training::{AUTOSAVE_S, TrainSettings};
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::scene::config::{BirthRule, DEFAULT_MAX_COMPONENTS};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::units::{Budget, DEFAULT_PIXELS, StructuralScale};
use crate::train::setting::Preset;
use crate::train::setting::table::{Setting, SettingLayer, Spelling};
use crate::train::setting::value::{Choice, SettingValue};
use eframe::egui::{CollapsingHeader, DragValue, Grid, RichText, TextEdit, Ui};
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Components of a budget when one is first set.
const FIRST_BUDGET: usize = 25_000;

/// Seconds between two saves on the way that can be chosen.
const AUTOSAVES_S: RangeInclusive<u32> = 1..=3600;

/// Draws the panel.
pub fn ui(settings: &mut TrainSettings, ui: &mut Ui) {
    ui.horizontal(|ui| {
        for (preset, label, tooltip) in [
            (Preset::Scene, "Scene preset", "Components are born where surfaces are seen"),
            (Preset::Paper, "Paper preset", "The published algorithm with its 100,000 components"),
        ] {
            ui.selectable_value(&mut settings.preset, preset, label).on_hover_text(tooltip);
        }
    });
    if settings.preset == Preset::Scene {
        let n = listed().filter(|setting| differs(setting, &settings.scene)).count();
        let title = if n == 0 { "Details".to_owned() } else { format!("Details: {n} changed") };
        let details = CollapsingHeader::new(title).id_salt("details");
        details.show(ui, |ui| self::details(&mut settings.scene, ui));
    }
    ui.label(RichText::new("Holds for what is opened next, and after Reset").weak());
    autosave(&mut settings.autosave_s, ui);
}

/// How often a run is saved on its way.
fn autosave(seconds: &mut Option<u32>, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut is_on = seconds.is_some();
        let help = "Beside training, so that a crash costs no more than this; the next start offers to go on";
        if ui.checkbox(&mut is_on, "Autosave every").on_hover_text(help).changed() {
            *seconds = is_on.then_some(AUTOSAVE_S);
        }
        let mut shown = seconds.unwrap_or(AUTOSAVE_S);
        let value = DragValue::new(&mut shown).range(AUTOSAVES_S).suffix(" s");
        if ui.add_enabled(is_on, value).changed() {
            *seconds = Some(shown);
        }
    });
}

/// The settings that the table gives a label.
fn listed() -> impl Iterator<Item = &'static Setting<SceneOverrides>> {
    SceneOverrides::TABLE.iter().filter(|setting| setting.about.label.is_some())
}

/// Whether a setting is given, and not as it is by default.
fn differs(setting: &Setting<SceneOverrides>, scene: &SceneOverrides) -> bool {
    (setting.given)(scene).is_some_and(|value| value != setting.about.default)
}

/// The mark of a setting that differs from its default; a click takes it back.
fn mark(setting: &Setting<SceneOverrides>, scene: &mut SceneOverrides, ui: &mut Ui) {
    let about = &setting.about;
    let default = match about.field {
        "budget" => "no budget",
        _ => about.default,
    };
    let is_back = badge::ui(about.label.unwrap_or_default(), default, differs(setting, scene), ui);
    if is_back {
        (setting.clear)(scene);
    }
}

/// First the settings with values, then what is on or off.
fn details(scene: &mut SceneOverrides, ui: &mut Ui) {
    let is_part = |setting: &&Setting<_>| matches!(setting.about.spelling, Spelling::Part(_));
    Grid::new("training").num_columns(3).min_col_width(0.0).show(ui, |ui| {
        for setting in listed().filter(|setting| !is_part(setting)) {
            let about = &setting.about;
            mark(setting, scene, ui);
            ui.label(about.label.unwrap_or_default()).on_hover_text(about.help());
            match about.field {
                "scale" => scale(scene, ui),
                "births" => choice(&mut scene.births, BirthRule::Seeds, ui),
                "budget" => budget(scene, ui),
                "photometric" => choice(&mut scene.photometric, PhotometricMode::Light, ui),
                _ => {}
            }
            ui.end_row();
        }
    });
    ui.label("Preparation of frames")
        .on_hover_text("The view “Preparation” shows what becomes of every pixel");
    listed().filter(is_part).for_each(|setting| part(setting, scene, ui));
}

/// Typed as on the command line: pixels with `px`, else world units.
fn scale(scene: &mut SceneOverrides, ui: &mut Ui) {
    let id = ui.make_persistent_id("scale as typed");
    let stored = String::from(scene.scale.unwrap_or(StructuralScale::Pixels(DEFAULT_PIXELS)));
    // Kept while it is typed: half a number is none, and must not be overwritten.
    let typed: Option<String> = ui.data(|data| data.get_temp(id));
    let mut text = typed.unwrap_or(stored);
    let field = ui.add(TextEdit::singleline(&mut text).desired_width(80.0));
    let field = field.on_hover_text("Pixels such as 2.5px, or world units such as 0.02");
    let parsed = text.parse::<StructuralScale>();
    if field.changed() {
        if let Ok(scale) = &parsed {
            scene.scale = Some(*scale);
        }
        ui.data_mut(|data| data.insert_temp(id, text));
    }
    if !field.has_focus() {
        ui.data_mut(|data| data.remove::<String>(id));
    } else if let Err(problem) = parsed {
        let color = SignalColor::Red.on(ui.visuals().dark_mode);
        ui.label(RichText::new(problem).color(color));
    }
}

/// One of few values; the default is left to the preset.
fn choice<T>(value: &mut Option<T>, default: T, ui: &mut Ui)
where
    T: SettingValue + FromStr + Copy,
{
    ui.horizontal(|ui| {
        for Choice { name, label, help } in T::choices() {
            let this = name.parse().unwrap_or(default);
            let is_chosen = value.unwrap_or(default) == this;
            if ui.selectable_label(is_chosen, label).on_hover_text(help).clicked() {
                *value = (this != default).then_some(this);
            }
        }
    });
}

fn budget(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut is_set = scene.budget.is_some();
        if ui.checkbox(&mut is_set, "At most").changed() {
            scene.budget = is_set.then_some(Budget::Components(FIRST_BUDGET));
        }
        if let Some(budget) = scene.budget {
            let mut components = budget.components();
            let value =
                DragValue::new(&mut components).range(1..=DEFAULT_MAX_COMPONENTS).speed(100.0);
            if ui.add(value.suffix(" components")).changed() {
                scene.budget = Some(Budget::Components(components));
            }
        }
    });
}

/// What is on unless it is left out.
fn part(setting: &Setting<SceneOverrides>, scene: &mut SceneOverrides, ui: &mut Ui) {
    let Some(&mut part) = (setting.flag)(scene) else { return };
    let mut is_on = part.unwrap_or(true);
    ui.horizontal(|ui| {
        let checkbox = ui.checkbox(&mut is_on, setting.about.label.unwrap_or_default());
        let is_changed = checkbox.on_hover_text(setting.about.help()).changed();
        if is_changed && let Some(part) = (setting.flag)(scene) {
            *part = (!is_on).then_some(false);
        }
        mark(setting, scene, ui);
    });
}
