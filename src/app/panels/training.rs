//! How what is opened or reset next is trained.

use crate::app::training::{AUTOSAVE_S, TrainSettings};
use crate::pipeline::settings::scene::SceneOverrides;
use crate::train::scene::config::{BirthRule, DEFAULT_MAX_COMPONENTS};
use crate::train::scene::photometric::rule::PhotometricMode;
use crate::train::scene::units::{Budget, DEFAULT_PIXELS, StructuralScale};
use crate::train::setting::Preset;
use crate::train::setting::table::{Setting, SettingLayer, Spelling};
use crate::train::setting::value::{Choice, SettingValue};
use eframe::egui::{Button, DragValue, Grid, RichText, Ui};
use std::ops::RangeInclusive;
use std::str::FromStr;

/// Structural scales that can be chosen, pixels.
const SCALES_PX: RangeInclusive<f64> = 0.5..=20.0;
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
        ui.collapsing("Details", |ui| details(&mut settings.scene, ui));
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

/// The settings that the table gives a label: first those with values, then what is on or off.
fn details(scene: &mut SceneOverrides, ui: &mut Ui) {
    let listed = || SceneOverrides::TABLE.iter().filter(|setting| setting.about.label.is_some());
    let is_part = |setting: &&Setting<_>| matches!(setting.about.spelling, Spelling::Part(_));
    Grid::new("training").num_columns(2).show(ui, |ui| {
        for Setting { about, .. } in listed().filter(|setting| !is_part(setting)) {
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

fn scale(scene: &mut SceneOverrides, ui: &mut Ui) {
    ui.horizontal(|ui| {
        let mut pixels = match scene.scale {
            Some(StructuralScale::Pixels(n)) => n,
            Some(StructuralScale::World(_)) | None => DEFAULT_PIXELS,
        };
        let value = DragValue::new(&mut pixels).range(SCALES_PX).speed(0.02).suffix(" px");
        if ui.add(value.max_decimals(2)).changed() {
            scene.scale = Some(StructuralScale::Pixels(pixels));
        }
        if ui.add_enabled(scene.scale.is_some(), Button::new("Reset scale")).clicked() {
            scene.scale = None;
        }
    });
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
    let Some(part) = (setting.flag)(scene) else { return };
    let mut is_on = part.unwrap_or(true);
    let checkbox = ui.checkbox(&mut is_on, setting.about.label.unwrap_or_default());
    if checkbox.on_hover_text(setting.about.help()).changed() {
        *part = (!is_on).then_some(false);
    }
}
